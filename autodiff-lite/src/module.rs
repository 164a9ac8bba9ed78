//! Trees of parameters.

use crate::{Param, Real};

/// Something made of parameters: a layer, a block, a whole model.
///
/// It is only about traversal; how a layer is called is its own affair. Implement it with
/// [`impl_module!`](crate::impl_module). Parameters, options, vectors, boxes, arrays and tuples
/// are modules too. The path of a parameter is made of field names and indices joined by dots,
/// which are PyTorch's state-dict names when the fields are named alike.
pub trait Module<F: Real = f32> {
    /// Visits each parameter with its path, in the order of the fields.
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<F>);

    /// Visits each parameter with its path, in the same order, to change it.
    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<F>);

    /// The number of trainable elements.
    fn parameter_count(&self) -> usize {
        let mut count = 0;
        self.visit("", &mut |_: &str, p: &Param<F>| {
            count += if p.trainable { p.len() } else { 0 };
        });
        count
    }

    /// Sets whether the parameters whose path begins with `prefix` are trained. [Buffers](Param::buffer) never are.
    fn set_trainable(&mut self, prefix: &str, trainable: bool) {
        self.visit_mut("", &mut |path: &str, p: &mut Param<F>| {
            if has_prefix(path, prefix) {
                p.trainable = trainable && !p.is_buffer();
            }
        });
    }
}

/// What is done at each parameter. Closures `FnMut(&str, &Param<F>)` are visitors.
pub trait Visitor<F: Real> {
    /// Sees one parameter.
    fn param(&mut self, path: &str, param: &Param<F>);
}

impl<F: Real, C: FnMut(&str, &Param<F>)> Visitor<F> for C {
    fn param(&mut self, path: &str, param: &Param<F>) {
        self(path, param);
    }
}

/// What is done to each parameter. Closures `FnMut(&str, &mut Param<F>)` are visitors.
pub trait VisitorMut<F: Real> {
    /// Sees one parameter and may change it.
    fn param(&mut self, path: &str, param: &mut Param<F>);
}

impl<F: Real, C: FnMut(&str, &mut Param<F>)> VisitorMut<F> for C {
    fn param(&mut self, path: &str, param: &mut Param<F>) {
        self(path, param);
    }
}

/// Whether `path` is `prefix` or lies below it. `"layer1"` covers `layer1.0.weight` and not
/// `layer10.weight`; the empty prefix and one that ends in a dot cover what they seem to.
pub(crate) fn has_prefix(path: &str, prefix: &str) -> bool {
    match path.strip_prefix(prefix) {
        Some(rest) => {
            prefix.is_empty() || prefix.ends_with('.') || rest.is_empty() || rest.starts_with('.')
        }
        None => false,
    }
}

/// `path.name`, or `name` at the root.
pub fn join_path(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}

impl<F: Real> Module<F> for Param<F> {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<F>) {
        visitor.param(path, self);
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<F>) {
        visitor.param(path, self);
    }
}

impl<F: Real, M: Module<F>> Module<F> for Option<M> {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<F>) {
        if let Some(module) = self {
            module.visit(path, visitor);
        }
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<F>) {
        if let Some(module) = self {
            module.visit_mut(path, visitor);
        }
    }
}

impl<F: Real, M: Module<F> + ?Sized> Module<F> for Box<M> {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<F>) {
        (**self).visit(path, visitor);
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<F>) {
        (**self).visit_mut(path, visitor);
    }
}

impl<F: Real, M: Module<F>> Module<F> for [M] {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<F>) {
        for (i, module) in self.iter().enumerate() {
            module.visit(&join_path(path, &i.to_string()), visitor);
        }
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<F>) {
        for (i, module) in self.iter_mut().enumerate() {
            module.visit_mut(&join_path(path, &i.to_string()), visitor);
        }
    }
}

impl<F: Real, M: Module<F>> Module<F> for Vec<M> {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<F>) {
        self.as_slice().visit(path, visitor);
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<F>) {
        self.as_mut_slice().visit_mut(path, visitor);
    }
}

impl<F: Real, M: Module<F>, const N: usize> Module<F> for [M; N] {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<F>) {
        self.as_slice().visit(path, visitor);
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<F>) {
        self.as_mut_slice().visit_mut(path, visitor);
    }
}

/// What has no parameters.
impl<F: Real> Module<F> for () {
    fn visit(&self, _: &str, _: &mut dyn Visitor<F>) {}

    fn visit_mut(&mut self, _: &str, _: &mut dyn VisitorMut<F>) {}
}

macro_rules! tuple_module {
    ($($module:ident $index:tt),*) => {
        impl<F: Real, $($module: Module<F>),*> Module<F> for ($($module,)*) {
            fn visit(&self, path: &str, visitor: &mut dyn Visitor<F>) {
                $(self.$index.visit(&join_path(path, stringify!($index)), visitor);)*
            }

            fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<F>) {
                $(self.$index.visit_mut(&join_path(path, stringify!($index)), visitor);)*
            }
        }
    };
}

tuple_module!(A 0);
tuple_module!(A 0, B 1);
tuple_module!(A 0, B 1, C 2);
tuple_module!(A 0, B 1, C 2, D 3);

/// Implements [`Module`] for a struct by naming all of its fields.
///
/// Fields in the first braces are modules and are visited under their names; those after `fixed`
/// are not. Lists after `lists` come before them, each module under the name that a function gives
/// its index, where files do not number them as `Vec` does. The struct is taken apart exhaustively,
/// so a forgotten field does not compile. With `= field` instead the module is that field, without a
/// name of its own.
///
/// ```
/// use autodiff_lite::{Module, Param, Real, impl_module};
///
/// struct Linear<F: Real = f32> {
///     weight: Param<F>,
///     bias: Option<Param<F>>,
///     scale: f64,
/// }
/// impl_module!(Linear { weight, bias } fixed { scale });
///
/// // A struct without a type parameter says which numbers it is made of.
/// struct Model {
///     layers: Vec<Linear>,
///     convs: Vec<Linear>,
/// }
/// impl_module!(Model: f32, lists { convs: |i| format!("conv{}", i + 1) } { layers });
///
/// struct System {
///     model: Model,
///     name: String,
/// }
/// impl_module!(System: f32 = model);
///
/// let linear = || Linear { weight: Param::new(ndarray::arr1(&[1.0])), bias: None, scale: 2.0 };
/// let model = Model { layers: vec![linear()], convs: vec![linear(), linear()] };
/// let system = System { model, name: "two and one".to_owned() };
/// let mut paths = Vec::new();
/// system.visit("", &mut |path: &str, _: &Param| paths.push(path.to_owned()));
/// assert_eq!(paths, ["conv1.weight", "conv2.weight", "layers.0.weight"]);
/// ```
#[macro_export]
macro_rules! impl_module {
    ($name:ident : $real:ty = $inner:ident) => {
        impl $crate::Module<$real> for $name {
            fn visit(&self, path: &str, visitor: &mut dyn $crate::Visitor<$real>) {
                self.$inner.visit(path, visitor);
            }

            fn visit_mut(&mut self, path: &str, visitor: &mut dyn $crate::VisitorMut<$real>) {
                self.$inner.visit_mut(path, visitor);
            }
        }
    };
    (
        $name:ident $(lists { $($list:ident: $by:expr),* $(,)? })? { $($field:ident),* $(,)? }
        $(fixed { $($fixed:ident),* $(,)? })?
    ) => {
        impl<F: $crate::Real> $crate::Module<F> for $name<F> {
            $crate::impl_module!(@body F [$($(($list, $by))*)?] [$($field)*] [$($($fixed)*)?]);
        }
    };
    (
        $name:ident : $real:ty $(, lists { $($list:ident: $by:expr),* $(,)? })? { $($field:ident),* $(,)? }
        $(fixed { $($fixed:ident),* $(,)? })?
    ) => {
        impl $crate::Module<$real> for $name {
            $crate::impl_module!(@body $real [$($(($list, $by))*)?] [$($field)*] [$($($fixed)*)?]);
        }
    };
    (@body $real:ty [$(($list:ident, $by:expr))*] [$($field:ident)*] [$($fixed:ident)*]) => {
        fn visit(&self, path: &str, visitor: &mut dyn $crate::Visitor<$real>) {
            let Self { $($list,)* $($field,)* $($fixed: _,)* } = self;
            let _ = (path, &visitor);
            $(for (i, module) in $list.iter().enumerate() {
                $crate::Module::<$real>::visit(module, &$crate::join_path(path, AsRef::<str>::as_ref(&$by(i))), visitor);
            })*
            $($crate::Module::<$real>::visit(
                $field, &$crate::join_path(path, stringify!($field)), visitor,
            );)*
        }

        fn visit_mut(&mut self, path: &str, visitor: &mut dyn $crate::VisitorMut<$real>) {
            let Self { $($list,)* $($field,)* $($fixed: _,)* } = self;
            let _ = (path, &visitor);
            $(for (i, module) in $list.iter_mut().enumerate() {
                $crate::Module::<$real>::visit_mut(module, &$crate::join_path(path, AsRef::<str>::as_ref(&$by(i))), visitor);
            })*
            $($crate::Module::<$real>::visit_mut(
                $field, &$crate::join_path(path, stringify!($field)), visitor,
            );)*
        }
    };
}

#[cfg(test)]
mod tests {
    use ndarray::{Array1, arr0};

    use super::*;

    fn param(n: usize) -> Param {
        Param::new(Array1::zeros(n))
    }

    struct Block {
        conv: Param,
        downsample: Option<(Param, Param)>,
        kernel: usize,
    }
    impl_module!(Block: f32 { conv, downsample } fixed { kernel });

    struct Model<F: Real = f32> {
        layer1: Vec<Param<F>>,
        boxed: Box<Param<F>>,
        heads: [Param<F>; 2],
        alone: (Param<F>,),
    }
    impl_module!(Model { layer1, boxed, heads, alone });

    #[test]
    fn paths_are_those_of_pytorch() {
        let block = Block { conv: param(2), downsample: Some((param(1), param(1))), kernel: 3 };
        let plain = Block { conv: param(2), downsample: None, kernel: block.kernel };
        let model = Model::<f64> {
            layer1: vec![Param::new(arr0(1.0))],
            boxed: Box::new(Param::new(arr0(1.0))),
            heads: [Param::new(arr0(1.0)), Param::buffer(Array1::zeros(7))],
            alone: (Param::new(arr0(1.0)),),
        };
        let mut paths = Vec::new();
        block.visit("layer1.0", &mut |path: &str, _: &Param| paths.push(path.to_owned()));
        plain.visit("", &mut |path: &str, _: &Param| paths.push(path.to_owned()));
        model.visit("", &mut |path: &str, _: &Param<f64>| paths.push(path.to_owned()));
        let expected = [
            "layer1.0.conv",
            "layer1.0.downsample.0",
            "layer1.0.downsample.1",
            "conv",
            "layer1.0",
            "boxed",
            "heads.0",
            "heads.1",
            "alone.0",
        ];
        assert_eq!(paths, expected);
        assert_eq!(block.parameter_count(), 4);
        assert_eq!(model.parameter_count(), 4, "a buffer does not count");
    }

    #[test]
    fn prefixes_end_at_dots() {
        assert!(has_prefix("layer1.0.weight", "layer1"));
        assert!(has_prefix("layer1.0.weight", "layer1."));
        assert!(has_prefix("weight", ""));
        assert!(has_prefix("weight", "weight"));
        assert!(!has_prefix("layer10.weight", "layer1"));
    }
}
