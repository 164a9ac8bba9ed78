//! Arrays as the tape takes and keeps them.

use std::fmt;
use std::ops::Deref;

use ndarray::{ArcArray, Array, ArrayBase, ArrayD, ArrayViewMutD, Data, Dimension, IxDyn};

/// Why the slice of a tensor cannot be missing: only [`Tensor::row_major`] makes tensors, and nothing hands out its
/// array to be changed.
const ROW_MAJOR: &str = "a tensor was row-major when it was made, and has kept its strides";

/// An array of any number of axes: row-major without gaps, shared by reference count, and copied when it is written
/// while somebody else holds it.
///
/// All there is on a tape is of this type: values, parameters, gradients, and arrays from the pool. Reading goes
/// through ndarray, as which a tensor can be [borrowed](Deref); loops take the [slice](Self::as_slice). There is no
/// mutable borrow of that kind, because with it the strides could be changed: write through
/// [`as_slice_mut`](Self::as_slice_mut) or [`view_mut`](Self::view_mut).
///
/// ```
/// use autodiff_lite::Tensor;
/// use ndarray::{ArrayD, arr2};
///
/// let mut x = Tensor::from(arr2(&[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]));
/// assert_eq!(x.shape(), [2, 3]);
/// assert_eq!(x[[1, 0]], 4.0);
/// assert_eq!(x.sum(), 21.0);
///
/// let before = x.clone(); // shares the memory
/// x.as_slice_mut()[0] = -1.0; // which is copied here
/// x.view_mut().swap([0, 1], [1, 2]);
/// assert_eq!(x.as_slice(), [-1.0, 6.0, 3.0, 4.0, 5.0, 2.0]);
/// assert_eq!(before.as_slice(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
///
/// // Another order of the axes is made row-major on the way in.
/// let columns = Tensor::from(arr2(&[[1.0, 2.0], [3.0, 4.0]]).reversed_axes());
/// assert_eq!(columns.as_slice(), [1.0, 3.0, 2.0, 4.0]);
/// let array: ArrayD<f64> = columns.into(); // no copy: nobody else held it
/// assert_eq!(array[[0, 1]], 3.0);
/// ```
///
/// # Shapes
/// The sizes of the axes are [`shape`](ndarray::LayoutRef::shape), the outermost first; a scalar has none, `[]`, and one
/// element. The element `[i, j, k]` of a tensor `[A, B, C]` is `as_slice()[(i * B + j) * C + k]`.
#[derive(Clone, PartialEq)]
pub struct Tensor<F = f32>(ArcArray<F, IxDyn>);

impl<F: Copy> Tensor<F> {
    /// The one place where tensors come from, which decides that they are row-major.
    fn row_major(array: ArcArray<F, IxDyn>) -> Self {
        if array.is_standard_layout() {
            Self(array)
        } else {
            Self(array.as_standard_layout().into_owned().into_shared())
        }
    }

    /// The elements, the last axis running fastest.
    pub fn as_slice(&self) -> &[F] {
        self.0.as_slice().expect(ROW_MAJOR)
    }

    /// The elements, to be written: in place when nobody else holds them, else in a copy of them that is made first.
    pub fn as_slice_mut(&mut self) -> &mut [F] {
        self.0.as_slice_mut().expect(ROW_MAJOR)
    }

    /// The elements as an array to be written, in place or in a copy as with [`as_slice_mut`](Self::as_slice_mut).
    ///
    /// # Shapes
    /// That of the tensor.
    pub fn view_mut(&mut self) -> ArrayViewMutD<'_, F> {
        self.0.view_mut()
    }

    /// The same elements under another shape. Nothing is copied.
    ///
    /// # Panics
    /// If the number of elements differs.
    #[must_use]
    #[track_caller]
    pub fn into_shape(self, shape: &[usize]) -> Self {
        let Ok(array) = self.0.into_shape_with_order(shape) else {
            panic!("a tensor cannot take the shape {shape:?}: the number of elements differs")
        };
        Self(array)
    }

    /// An array of one's own: the memory itself when nobody else holds it, else a copy.
    ///
    /// # Shapes
    /// That of the tensor.
    pub fn into_owned(self) -> ArrayD<F> {
        self.0.into_owned()
    }

    /// A copy as an array of one's own.
    ///
    /// # Shapes
    /// That of the tensor.
    pub fn to_owned(&self) -> ArrayD<F> {
        self.0.to_owned()
    }

    /// The memory itself, if nobody else holds it.
    pub(crate) fn try_into_vec(self) -> Option<Vec<F>> {
        self.0.try_into_owned_nocopy().ok().map(|array| array.into_raw_vec_and_offset().0)
    }
}

impl<F> Deref for Tensor<F> {
    type Target = ArcArray<F, IxDyn>;

    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

/// Equal where shape and elements are, as arrays of ndarray.
impl<F: PartialEq, S: Data<Elem = F>, D: Dimension> PartialEq<ArrayBase<S, D>> for Tensor<F> {
    fn eq(&self, other: &ArrayBase<S, D>) -> bool {
        self.0 == other.view().into_dyn()
    }
}

/// Element by element, the last axis running fastest.
impl<'a, F: Copy> IntoIterator for &'a Tensor<F> {
    type Item = &'a F;
    type IntoIter = std::slice::Iter<'a, F>;

    fn into_iter(self) -> Self::IntoIter {
        self.as_slice().iter()
    }
}

/// As ndarray prints arrays.
impl<F: fmt::Debug> fmt::Debug for Tensor<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Takes the memory over; an array that is not row-major is copied.
impl<F: Copy, D: Dimension> From<Array<F, D>> for Tensor<F> {
    fn from(array: Array<F, D>) -> Self {
        Self::row_major(array.into_dyn().into_shared())
    }
}

/// Shares the memory; an array that is not row-major is copied.
impl<F: Copy, D: Dimension> From<ArcArray<F, D>> for Tensor<F> {
    fn from(array: ArcArray<F, D>) -> Self {
        Self::row_major(array.into_dyn())
    }
}

/// A number is an array without axes.
impl From<f32> for Tensor<f32> {
    fn from(x: f32) -> Self {
        ndarray::arr0(x).into()
    }
}

/// A number is an array without axes.
impl From<f64> for Tensor<f64> {
    fn from(x: f64) -> Self {
        ndarray::arr0(x).into()
    }
}

/// One axis. Nothing is copied.
impl<F: Copy> From<Vec<F>> for Tensor<F> {
    fn from(numbers: Vec<F>) -> Self {
        ndarray::Array1::from_vec(numbers).into()
    }
}

/// As [`Tensor::into_owned`].
impl<F: Copy> From<Tensor<F>> for ArrayD<F> {
    fn from(tensor: Tensor<F>) -> Self {
        tensor.into_owned()
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{arr1, arr2, s};

    use super::*;

    #[test]
    fn it_is_written_in_place_unless_it_is_shared() {
        let mut x = Tensor::from(arr1(&[1.0, 2.0]));
        let address = x.as_ptr();
        x.as_slice_mut()[0] = 3.0;
        x.view_mut()[1] = 4.0;
        assert_eq!((x.as_ptr(), x.as_slice()), (address, &[3.0, 4.0][..]));
        let other = x.clone();
        x.as_slice_mut()[0] = 5.0;
        assert_ne!(x.as_ptr(), address);
        assert_eq!((other.as_ptr(), other.as_slice()), (address, &[3.0, 4.0][..]));
    }

    #[test]
    fn memory_comes_and_goes_without_a_copy() {
        let array = arr2(&[[1.0, 2.0], [3.0, 4.0]]);
        let address = array.as_ptr();
        let x = Tensor::from(array).into_shape(&[4]);
        assert_eq!(x.as_ptr(), address);
        let shared = x.clone();
        assert_ne!(x.into_owned().as_ptr(), address, "somebody else holds it");
        assert_eq!(ArrayD::from(shared).as_ptr(), address);
    }

    #[test]
    fn it_is_row_major_whatever_it_is_made_of() {
        let array = arr2(&[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]).into_shared();
        let turned = Tensor::from(array.clone().reversed_axes());
        assert_eq!(
            (turned.shape(), turned.as_slice()),
            (&[3, 2][..], &[1.0, 4.0, 2.0, 5.0, 3.0, 6.0][..])
        );
        let column = Tensor::from(array.clone().slice_move(s![.., 1..2]));
        assert_eq!(column.as_slice(), [2.0, 5.0]);
        let mut row = Tensor::from(array.clone().slice_move(s![1.., ..]));
        assert_eq!(row.as_slice(), [4.0, 5.0, 6.0], "a part without gaps is shared");
        row.as_slice_mut().fill(0.0);
        assert_eq!(array[[1, 0]], 4.0);
        assert!(Tensor::from(ArrayD::<f32>::zeros(vec![2, 0, 3])).as_slice().is_empty());
    }

    #[test]
    #[should_panic(expected = "a tensor cannot take the shape [3]: the number of elements differs")]
    fn a_shape_of_another_length() {
        let _ = Tensor::from(arr1(&[1.0, 2.0])).into_shape(&[3]);
    }
}
