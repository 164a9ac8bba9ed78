//! How alike two images are: L1, PSNR, SSIM.
//!
//! Values are `f32` in `[0, 1]`, sums are `f64`. Two images of different dimensions are a mistake of the
//! caller and panic.

use mesh_core::Image;

use crate::kernels::ssim;

/// Mean absolute difference over all values.
///
/// On images with a common black background the background agrees and pulls the figure down; that is
/// how the published tables are made, so compare only figures with the same share of background.
pub fn l1(image: &Image, target: &Image) -> f64 {
    same_size("l1", image, target);
    mean(image, target, f64::abs)
}

/// Mean squared difference over all values.
pub fn mse(image: &Image, target: &Image) -> f64 {
    same_size("mse", image, target);
    mean(image, target, |d| d * d)
}

/// Peak signal-to-noise ratio in decibels, `-10 log10(mse)`, for values in `[0, 1]`.
///
/// Infinite when the images are equal.
///
/// ```
/// use mesh_core::Image;
/// let black = Image::new(4, 4, 3);
/// let mut gray = black.clone();
/// gray.data.fill(0.1); // mean squared error 0.01
/// assert!((losses::metrics::psnr(&gray, &black) - 20.0).abs() < 1e-5);
/// ```
pub fn psnr(image: &Image, target: &Image) -> f64 {
    decibels(mse(image, target))
}

/// [`psnr`] over the pixels where `mask` (one channel) is above one half; `None` when there are none.
pub fn psnr_inside(image: &Image, target: &Image, mask: &Image) -> Option<f64> {
    same_size("psnr_inside", image, target);
    assert!(
        mask.channels == 1 && mask.height == image.height && mask.width == image.width,
        "psnr_inside: the mask does not fit the image\n  image {}\n  mask  {}",
        size(image),
        size(mask)
    );
    let c = image.channels;
    let (mut total, mut count) = (0.0, 0usize);
    for (p, &m) in mask.data.iter().enumerate() {
        if m > 0.5 {
            let range = p * c..(p + 1) * c;
            for (&a, &b) in image.data[range.clone()].iter().zip(&target.data[range]) {
                let d = f64::from(a) - f64::from(b);
                total += d * d;
            }
            count += c;
        }
    }
    (count > 0).then(|| decibels(total / count as f64))
}

/// Structural similarity, 1 for equal images.
///
/// 11 x 11 Gaussian window of standard deviation 1.5, `C1 = 1e-4`, `C2 = 9e-4`, zero padding, the mean
/// over all pixels and channels: the form of the MCMR evaluation.
///
/// # References
/// Wang, Bovik, Sheikh, Simoncelli 2004, *Image Quality Assessment: From Error Visibility to Structural
/// Similarity*.
pub fn ssim(image: &Image, target: &Image) -> f64 {
    same_size("ssim", image, target);
    ssim_within(image, target, 0)
}

/// [`ssim()`] as the mean over the pixels whose window lies within the image: without five rows and columns at each
/// border. `NaN` where none is left.
///
/// # References
/// `structural_similarity(gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=1)` of
/// scikit-image, and the figures of most papers.
pub fn ssim_valid(image: &Image, target: &Image) -> f64 {
    same_size("ssim_valid", image, target);
    ssim_within(image, target, ssim::RADIUS)
}

fn ssim_within(image: &Image, target: &Image, margin: usize) -> f64 {
    if image.data.is_empty() {
        return 1.0;
    }
    let plane = ssim::Plane {
        images: 1,
        height: image.height,
        width: image.width,
        channels: image.channels,
        margin,
    };
    let mut scratch = vec![0.0f32; plane.scratch_len()];
    ssim::ssim(&image.data, &target.data, plane, &mut scratch, None)
}

fn decibels(mse: f64) -> f64 {
    -10.0 * mse.log10()
}

fn mean(image: &Image, target: &Image, f: impl Fn(f64) -> f64) -> f64 {
    let total: f64 =
        image.data.iter().zip(&target.data).map(|(&a, &b)| f(f64::from(a) - f64::from(b))).sum();
    total / image.data.len().max(1) as f64
}

#[track_caller]
pub(super) fn same_size(name: &str, image: &Image, target: &Image) {
    assert!(
        image.height == target.height
            && image.width == target.width
            && image.channels == target.channels
            && image.data.len() == target.data.len(),
        "{name}: the images differ in size\n  image  {}\n  target {}",
        size(image),
        size(target)
    );
}

fn size(image: &Image) -> String {
    format!("[{}, {}, {}]   (H, W, C)", image.height, image.width, image.channels)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    fn image(height: usize, width: usize, channels: usize, f: impl Fn(usize) -> f32) -> Image {
        Image { height, width, channels, data: (0..height * width * channels).map(f).collect() }
    }

    #[test]
    fn equal_images_are_perfect() {
        let a = image(7, 9, 3, |i| (i as f32 * 0.37).sin().abs());
        assert_eq!(l1(&a, &a), 0.0);
        assert_eq!(psnr(&a, &a), f64::INFINITY);
        assert_relative_eq!(ssim(&a, &a), 1.0, epsilon = 1e-6);
    }

    #[test]
    fn psnr_inside_looks_at_the_mask_alone() {
        let a = image(2, 2, 1, |i| if i < 2 { 0.1 } else { 1.0 });
        let b = image(2, 2, 1, |_| 0.0);
        let mask = image(2, 2, 1, |i| f32::from(u8::from(i < 2)));
        assert_relative_eq!(psnr_inside(&a, &b, &mask).unwrap(), 20.0, epsilon = 1e-5);
        assert_eq!(psnr_inside(&a, &b, &image(2, 2, 1, |_| 0.0)), None);
    }

    #[test]
    fn ssim_of_constants_is_the_luminance_term_far_from_the_border() {
        // Zero padding: the window sums s < 1 near the border, so a constant c has mean s c and second
        // moment s c². At the centre of a large image s = 1 and only luminance is left.
        let (a, b) = (0.3f64, 0.7f64);
        let c1 = 1e-4;
        let luminance = (2.0 * a * b + c1) / (a * a + b * b + c1);
        let plain = |v: f64| image(301, 301, 1, |_| v as f32);
        // The border is 5 of 301 pixels wide on each side, so the mean is within a few per cent.
        assert!((ssim(&plain(a), &plain(b)) - luminance).abs() < 0.05);
    }

    #[test]
    #[should_panic(expected = "the images differ in size")]
    fn sizes_must_agree() {
        l1(&Image::new(2, 2, 3), &Image::new(2, 3, 3));
    }
}
