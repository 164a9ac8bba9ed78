//! How much brighter than the others a photograph is, channel by channel: exposure and white balance.
//!
//! A camera that chooses its exposure anew for each photograph multiplies all of its light by a factor, and one that chooses its
//! white balance each channel by its own. In sRGB, nearly a power of the light, such a factor stays a factor. Colours of the
//! surface and factors of the views explain the photographs together, each found by least squares where the others are known;
//! only ratios can be seen, so the factors' geometric mean is 1.

use mesh_core::Topology;
use rayon::prelude::*;

use super::color;
use super::sight::{Photographed, Sight};

/// Rounds at most.
const ROUNDS: usize = 16;
/// How much farther than to the least squares each goes: of what is left a round keeps 0.7, and 0.8 without.
const RELAXATION: f32 = 1.6;
/// Factors that change by less are found.
const FOUND: f32 = 1e-3;
/// Photographs differ if their factors leave at most this share of the squared difference.
const LEFT: f64 = 0.5;
/// And if one of them is as far from 1.
const LEAST: f32 = 0.02;
/// Factors of photographs of one object are at most so far apart from the mean, in sRGB: six stops of light, and as much the other way. What
/// seems to be more has another cause, such as masks that are of the background.
const MOST: f32 = 8.0;
/// What a channel clips, below or above, says nothing about its factor.
const CLIPPED: [f32; 2] = [0.02, 0.98];

/// What each view's colours are multiplied by to be those of the surface, red, green, blue.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Exposure {
    /// One a view.
    factors: Vec<[f32; 3]>,
}

/// Weighted sums over a view's pixels: photograph times surface, photograph squared, surface squared.
type Sums = [[f64; 3]; 3];

impl Exposure {
    /// All views alike.
    pub(crate) fn even(views: usize) -> Self {
        Self { factors: vec![[1.0; 3]; views] }
    }

    /// A view's colour, as that of the surface.
    pub(crate) fn brought(&self, view: usize, color: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|c| self.factors[view][c] * color[c])
    }

    /// What each view's colours are of those of the surface.
    pub(crate) fn relative(&self) -> Vec<[f32; 3]> {
        self.factors.iter().map(|factors| factors.map(f32::recip)).collect()
    }

    /// Finds the factors where views differ, and makes the colours those of all views together; none, and the colours as
    /// they are, where one light explains the photographs nearly as well.
    pub(crate) fn found(
        seen: &Photographed<'_>,
        topology: &Topology,
        colors: &mut Vec<[f32; 3]>,
    ) -> Option<Self> {
        let sums = summed(seen, colors);
        let even = Self::even(sums.len());
        let mut exposure = Self::of(&sums);
        if exposure.change(&even) < LEAST {
            return None;
        }
        // Colours that took each view as it is have taken up much of what views differ by: whether factors explain it is seen at
        // the end.
        let (before, mut after) = (even.difference(&sums), 0.0);
        let mut balanced = colors.clone();
        for _ in 0..ROUNDS {
            color::again(seen, topology, &exposure, &mut balanced);
            let sums = summed(seen, &balanced);
            let next = Self::of(&sums);
            after = next.difference(&sums);
            let change = next.change(&exposure);
            exposure = exposure.towards(&next);
            if !exposure.is_plausible() {
                return None;
            }
            if change < FOUND {
                break;
            }
        }
        if after > LEFT * before || exposure.change(&even) < LEAST {
            return None;
        }
        *colors = color::vertex_colors(seen, topology, &exposure, None);
        Some(exposure)
    }

    /// The factors of least squares, of geometric mean 1; 1 where a view says nothing.
    fn of(sums: &[Sums]) -> Self {
        let factor = |[product, photograph, _]: &Sums, c: usize| {
            let factor = product[c] / photograph[c];
            (factor.is_finite() && factor > 0.0).then_some(factor)
        };
        let mean: [f64; 3] = std::array::from_fn(|c| {
            let logarithms = sums.iter().filter_map(|sums| Some(factor(sums, c)?.ln()));
            let (sum, count) = logarithms.fold((0.0, 0), |(sum, n), log| (sum + log, n + 1));
            (sum / f64::from(count.max(1))).exp()
        });
        let one = |sums| {
            std::array::from_fn(|c| factor(sums, c).map_or(1.0, |factor| (factor / mean[c]) as f32))
        };
        Self { factors: sums.iter().map(one).collect() }
    }

    /// The squared difference that the factors leave.
    fn difference(&self, sums: &[Sums]) -> f64 {
        let one = |(factors, [product, photograph, surface]): (&[f32; 3], &Sums)| -> f64 {
            let left = |c: usize| {
                let f = f64::from(factors[c]);
                f * f * photograph[c] - 2.0 * f * product[c] + surface[c]
            };
            (0..3).map(left).sum()
        };
        self.factors.iter().zip(sums).map(one).sum()
    }

    /// Beyond what least squares say, as overrelaxation goes.
    fn towards(&self, next: &Self) -> Self {
        let pairs = self.factors.iter().zip(&next.factors);
        let one = |(a, b): (&[f32; 3], &[f32; 3])| -> [f32; 3] {
            std::array::from_fn(|c| a[c] * (b[c] / a[c]).powf(RELAXATION))
        };
        Self { factors: pairs.map(one).collect() }
    }

    /// Whether cameras differ by such factors.
    fn is_plausible(&self) -> bool {
        self.factors.iter().flatten().all(|factor| (1.0 / MOST..=MOST).contains(factor))
    }

    /// The largest difference of a factor.
    fn change(&self, other: &Self) -> f32 {
        let pairs = self.factors.iter().flatten().zip(other.factors.iter().flatten());
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }
}

/// Least and greatest of what views are of the surface.
pub(crate) fn range(exposures: Option<&[[f32; 3]]>) -> Option<[f32; 2]> {
    let all = || exposures.into_iter().flatten().flatten().copied();
    all().reduce(f32::min).zip(all().reduce(f32::max)).map(|(least, most)| [least, most])
}

fn summed(seen: &Photographed<'_>, colors: &[[f32; 3]]) -> Vec<Sums> {
    let one = |view: usize| {
        let mut sums = [[0.0; 3]; 3];
        seen.samples(&mut Sight::default(), view, |sample| {
            let mix = sample.interpolate(seen.faces, colors);
            for c in 0..3 {
                if !(CLIPPED[0]..CLIPPED[1]).contains(&sample.color[c]) {
                    continue;
                }
                let [photograph, surface] = [sample.color[c], mix[c]].map(f64::from);
                let weight = f64::from(sample.weight);
                sums[0][c] += weight * photograph * surface;
                sums[1][c] += weight * photograph * photograph;
                sums[2][c] += weight * surface * surface;
            }
        });
        sums
    };
    (0..seen.targets.len()).into_par_iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: a view twice as bright and one half as bright as the surface, and what gauge and nothing make of it.
    #[test]
    fn factors_are_those_of_least_squares() {
        let sums = |brightness: f64| {
            // Surfaces 0.1 and 0.3, each once.
            [[brightness * 0.1; 3], [brightness * brightness * 0.1; 3], [0.1; 3]]
        };
        let views = [sums(2.0), sums(0.5), [[0.0; 3]; 3]];
        let found = Exposure::of(&views);
        // A view that says nothing has no part in the mean.
        let of_blind = Exposure::of(&[sums(2.0), sums(2.0), [[0.0; 3]; 3]]);
        assert!(of_blind.factors.iter().flatten().all(|f| (f - 1.0).abs() < 1e-6));
        assert_eq!(found.factors, [[0.5; 3], [2.0; 3], [1.0; 3]]);
        assert_eq!(found.relative()[0], [2.0; 3]);
        assert!(found.difference(&views).abs() < 1e-12);
        assert!((Exposure::even(3).difference(&views) - 3.0 * (0.1 + 0.025)).abs() < 1e-12);
        assert_eq!(found.brought(1, [0.1, 0.2, 0.3]), [0.2, 0.4, 0.6]);
        assert_eq!(found.change(&Exposure::even(3)), 1.0);
        assert!(found.is_plausible());
        assert!(!Exposure::of(&[sums(16.0), sums(0.03)]).is_plausible());
        assert!(!Exposure { factors: vec![[1.0, f32::NAN, 1.0]] }.is_plausible());
    }
}
