//! The small Cholesky factor against nalgebra.

#![allow(clippy::unwrap_used)]

use proptest::prelude::*;
use vsf_core::SymmetricFactor;
use vsf_core::nalgebra::{DMatrix, DVector};

proptest! {
    #[test]
    fn solves_what_nalgebra_solves(
        (d, entries, rhs) in (1usize..10).prop_flat_map(|d| (
            Just(d),
            prop::collection::vec(-1.0..1.0f64, d * d),
            prop::collection::vec(-1.0..1.0f64, d),
        ))
    ) {
        let a = DMatrix::from_row_slice(d, d, &entries);
        let spd = &a * a.transpose() + DMatrix::identity(d, d) * 0.1;
        let row_major: Vec<f64> = spd.transpose().iter().copied().collect();
        let mut factor = SymmetricFactor::default();
        factor.factor("test", d, &row_major).unwrap();
        let mut x = rhs.clone();
        factor.solve(&mut x);
        let expected = spd.clone().cholesky().unwrap().solve(&DVector::from_vec(rhs));
        for (a, b) in x.iter().zip(expected.iter()) {
            prop_assert!((a - b).abs() < 1e-9 * (1.0 + b.abs()));
        }
        prop_assert!((factor.log_det() - spd.determinant().ln()).abs() < 1e-8);
    }
}

#[test]
fn an_indefinite_matrix_is_refused_with_its_pivot() {
    let error = SymmetricFactor::default()
        .factor("test", 2, &[1.0, 2.0, 2.0, 1.0])
        .unwrap_err();
    assert!(error.to_string().contains("pivot 1"), "{error}");
}
