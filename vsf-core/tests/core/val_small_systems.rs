//! The small Cholesky factor, and what is told of an innovation by it, against nalgebra.

use proptest::prelude::*;
use std::f64::consts::TAU;
use vsf_core::nalgebra::{DMatrix, DVector};
use vsf_core::{SymmetricFactor, UpdateReport};

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

        let lower = spd.cholesky().unwrap().l();
        let mut inverse = vec![f64::NAN; 3];
        factor.inverse_lower(&mut inverse);
        let product = DMatrix::from_row_slice(d, d, &inverse) * lower;
        prop_assert!((product - DMatrix::identity(d, d)).amax() < 1e-9);
        for j in 0..d {
            let mut column = vec![0.0; d];
            column[j] = 1.0;
            factor.solve_lower(&mut column);
            let found = inverse[j..].iter().step_by(d);
            prop_assert!(found.zip(&column).all(|(a, b)| a.to_bits() == b.to_bits()));
        }
    }

    /// The density of a Gaussian, by its definition.
    #[test]
    fn a_report_holds_the_density_of_the_innovation(
        (d, entries, residual) in (1usize..6).prop_flat_map(|d| (
            Just(d),
            prop::collection::vec(-1.0..1.0f64, d * d),
            prop::collection::vec(-1.0..1.0f64, d),
        ))
    ) {
        let a = DMatrix::from_row_slice(d, d, &entries);
        let s = &a * a.transpose() + DMatrix::identity(d, d) * 0.1;
        let mut factor = SymmetricFactor::default();
        factor.factor("test", d, s.as_slice()).unwrap();
        let mut whitened = residual.clone();
        factor.solve_lower(&mut whitened);
        let report = UpdateReport::from_innovation(7, &residual, &whitened, factor.log_det());
        let r = DVector::from_vec(residual);
        let nis = r.dot(&(s.clone().try_inverse().unwrap() * &r));
        let density = (-0.5 * nis).exp() / (TAU.powi(d as i32) * s.determinant()).sqrt();
        prop_assert!((report.nis - nis).abs() < 1e-9 * (1.0 + nis));
        prop_assert!((report.log_likelihood - density.ln()).abs() < 1e-8);
        prop_assert!((report.prefit - r.norm()).abs() < 1e-12);
        prop_assert_eq!((report.contacts, report.dof), (7, d));
        prop_assert_eq!((report.postfit, report.projected), (0.0, 0));
    }
}

#[test]
fn an_indefinite_matrix_is_refused_with_its_pivot() {
    let error = SymmetricFactor::default()
        .factor("test", 2, &[1.0, 2.0, 2.0, 1.0])
        .unwrap_err();
    assert!(error.to_string().contains("pivot 1"), "{error}");
}
