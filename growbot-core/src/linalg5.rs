//! Linear algebra in five dimensions: systems of five linear equations.
//!
//! nalgebra also solves such systems, but through views whose sizes are only known at run time. In the firmware its
//! code leaves panics that no input can cause but that the compiler cannot exclude. The operations here are those of
//! nalgebra, in the same order, so the results have the same bits.

use core::cmp::Ordering;
use core::mem;

use nalgebra::{Matrix5, Vector5};

use crate::float::PortableFloat;

/// Solves `matrix x = right` by Gaussian elimination with partial pivoting. `None` if the matrix is singular.
#[inline(never)]
pub fn solve<T: PortableFloat>(matrix: &Matrix5<T>, right: &Vector5<T>) -> Option<Vector5<T>> {
    let (zero, one) = (T::literal(0.0), T::literal(1.0));
    // Each row is an equation, with its right side as the last number.
    let mut rows = [[zero; 6]; 5];
    for (column, numbers) in matrix.data.0.iter().chain(&right.data.0).enumerate() {
        for (row, number) in rows.iter_mut().zip(numbers) {
            if let Some(place) = row.get_mut(column) {
                *place = *number;
            }
        }
    }
    let mut left = rows.as_mut_slice();
    for column in 0..5 {
        let (pivot, below) = left.split_first_mut()?;
        for row in below.iter_mut() {
            if row[column].abs() > pivot[column].abs() {
                mem::swap(row, pivot);
            }
        }
        if pivot[column] == zero {
            return None;
        }
        let inverse = one / pivot[column];
        for row in below.iter_mut() {
            let factor = row[column] * inverse;
            for (number, above) in row.iter_mut().zip(&*pivot).skip(column + 1) {
                *number -= *above * factor;
            }
        }
        left = below;
    }
    let mut solution = [zero; 5];
    let mut left = rows.as_mut_slice();
    for column in (0..5).rev() {
        let (row, above) = left.split_last_mut()?;
        let value = row[5] / row[column];
        solution[column] = value;
        for other in above.iter_mut() {
            other[5] -= value * other[column];
        }
        left = above;
    }
    Some(solution.into())
}

/// The Cholesky factor of a symmetric matrix, by columns. Entries above the diagonal have no meaning.
#[derive(Debug, Clone)]
pub struct Cholesky<T>([[T; 5]; 5]);

impl<T: PortableFloat> Cholesky<T> {
    /// Factorizes a symmetric matrix, of which only the lower triangle is read. `None` if the matrix is not positive
    /// definite.
    #[inline(never)]
    pub fn new(matrix: &Matrix5<T>) -> Option<Self> {
        let mut columns = matrix.data.0;
        let mut left = columns.as_mut_slice();
        for index in 0..5 {
            let (column, others) = left.split_first_mut()?;
            let square = column[index];
            if square.partial_cmp(&T::literal(0.0)) != Some(Ordering::Greater) {
                return None;
            }
            let root = square.root();
            column[index] = root;
            for number in column.iter_mut().skip(index + 1) {
                *number /= root;
            }
            for (row, other) in (index + 1..5).zip(others.iter_mut()) {
                let factor = column[row];
                for (number, before) in other.iter_mut().zip(&*column).skip(row) {
                    *number -= factor * *before;
                }
            }
            left = others;
        }
        Some(Self(columns))
    }

    /// Solves `matrix x = right`, where `matrix` is the matrix that was factorized.
    #[inline(never)]
    pub fn solve(&self, right: &Vector5<T>) -> Vector5<T> {
        let mut solution: [T; 5] = (*right).into();
        let mut left = solution.as_mut_slice();
        for (index, column) in (0..5).zip(&self.0) {
            let Some((value, below)) = left.split_first_mut() else { break };
            *value /= column[index];
            for (number, factor) in below.iter_mut().zip(column.iter().skip(index + 1)) {
                *number -= *value * *factor;
            }
            left = below;
        }
        for (index, column) in (0..5).zip(&self.0).rev() {
            let below = solution.iter().zip(column).skip(index + 1).fold(T::literal(0.0), |sum, (a, b)| sum + *a * *b);
            solution[index] = (solution[index] - below) / column[index];
        }
        solution.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn number() -> impl Strategy<Value = f64> {
        prop_oneof![4 => -1.0..1.0, 1 => Just(0.0)]
    }

    proptest! {
        #[test]
        fn solutions_match_nalgebra(numbers in prop::array::uniform30(number())) {
            let matrix = Matrix5::from_fn(|row, column| numbers[5 * row + column]);
            let right = Vector5::from_fn(|row, _| numbers[25 + row]);
            prop_assert_eq!(solve(&matrix, &right), matrix.lu().solve(&right));
        }

        #[test]
        fn factors_match_nalgebra(numbers in prop::array::uniform30(number()), raised in -0.1..1.0) {
            let matrix = Matrix5::from_fn(|row, column| numbers[5 * row + column]);
            let square = matrix * matrix.transpose() + Matrix5::identity() * raised;
            let right = Vector5::from_fn(|row, _| numbers[25 + row]);
            let solved = Cholesky::new(&square).map(|factor| factor.solve(&right));
            prop_assert_eq!(solved, square.cholesky().map(|factor| factor.solve(&right)));
        }
    }

    #[test]
    fn a_singular_matrix_has_no_solution() {
        let mut matrix = Matrix5::identity();
        matrix[(3, 3)] = 0.0;
        assert_eq!(solve(&matrix, &Vector5::repeat(1.0)), None);
        assert!(Cholesky::new(&matrix).is_none());
    }
}
