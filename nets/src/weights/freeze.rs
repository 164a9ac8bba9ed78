//! Which parameters are trained, by their paths.

use autodiff_lite::{Module, Param, Real};

/// Stops the training of all parameters that `pattern` names; their number.
///
/// A pattern with `*` must cover the whole path, each `*` standing for any characters, dots
/// included: `*.bias`, `features.*.weight`. One without is the path of a parameter or of a part
/// of the model: `features` freezes all below it, and nothing of `features2`. A result of 0 means
/// a mistake in the pattern.
///
/// ```
/// use nets::{Init, Vgg16, freeze, unfreeze};
/// use autodiff_lite::Module;
///
/// let mut vgg = Vgg16::<f32>::features_until_pool(&Init::new(0), 1);
/// assert_eq!(freeze(&mut vgg, "features"), 4);
/// assert_eq!(unfreeze(&mut vgg, "*.bias"), 2);
/// assert_eq!(vgg.parameter_count(), 128);
/// ```
pub fn freeze<F: Real>(module: &mut (impl Module<F> + ?Sized), pattern: &str) -> usize {
    set(module, pattern, false)
}

/// Takes up the training of all parameters that `pattern` names, but for [buffers](Param::buffer) (running statistics, frozen
/// norms), which no optimiser may touch; their number. Patterns are those of [`freeze`].
pub fn unfreeze<F: Real>(module: &mut (impl Module<F> + ?Sized), pattern: &str) -> usize {
    set(module, pattern, true)
}

fn set<F: Real>(module: &mut (impl Module<F> + ?Sized), pattern: &str, trainable: bool) -> usize {
    let mut count = 0;
    module.visit_mut("", &mut |path: &str, param: &mut Param<F>| {
        if matches(pattern, path) && !(trainable && param.is_buffer()) {
            param.trainable = trainable;
            count += 1;
        }
    });
    count
}

fn matches(pattern: &str, path: &str) -> bool {
    let Some((first, rest)) = pattern.split_once('*') else {
        let below = path.strip_prefix(pattern.trim_end_matches('.'));
        return below.is_some_and(|r| r.is_empty() || r.starts_with('.')) || pattern.is_empty();
    };
    let Some(mut path) = path.strip_prefix(first) else { return false };
    let mut parts: Vec<&str> = rest.split('*').collect();
    let last = parts.pop().unwrap_or_default();
    for part in parts {
        // The leftmost place leaves the most for what follows.
        let Some(at) = path.find(part) else { return false };
        path = &path[at + part.len()..];
    }
    path.ends_with(last)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BatchNorm2d, FrozenBatchNorm2d, Init};

    #[test]
    fn patterns() {
        let yes = [
            ("features", "features.0.weight"),
            ("features.", "features.0.weight"),
            ("a.b", "a.b"),
            ("", "a"),
            ("*", "a.b"),
            ("*.bias", "a.0.bias"),
            ("a.*.w", "a.b.c.w"),
            ("a*b*c", "abbc"),
        ];
        let no = [
            ("features", "features2.weight"),
            ("*.bias", "a.bias.x"),
            ("a.*.w", "a.w"),
            ("a*b*c", "acb"),
            ("aa*aa", "aaa"),
        ];
        for (pattern, path) in yes {
            assert!(matches(pattern, path), "{pattern} {path}");
        }
        for (pattern, path) in no {
            assert!(!matches(pattern, path), "{pattern} {path}");
        }
    }

    #[test]
    fn statistics_are_never_trained() {
        let mut norm = BatchNorm2d::<f32>::new(&Init::new(0), 3);
        assert_eq!(freeze(&mut norm, "*"), 4);
        assert_eq!(unfreeze(&mut norm, "*"), 2);
        assert_eq!(norm.parameter_count(), 6);
        assert_eq!(freeze(&mut norm, "wieght"), 0);
        // Nor is what is called otherwise but fixed.
        let mut frozen = FrozenBatchNorm2d::<f32>::new(&Init::new(0), 3);
        assert_eq!(unfreeze(&mut frozen, "*"), 0);
        frozen.set_trainable("", true);
        assert_eq!(frozen.parameter_count(), 0);
    }
}
