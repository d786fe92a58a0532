/// Second moment about zero of a unit Gaussian with mean `-t <= 0` cut off below zero; 1 at
/// `t = 0`, about `2 / t²` far from it. Relative error 4e-8 with a `DEPTH` of 200, 5e-6 with 32.
///
/// It is `2 I_2 / I_0` with the repeated integrals of the Gaussian tail, whose ratios
/// `r_n = I_n / I_{n-1}` obey `1 / r_{n-1} = t + n r_n` (Abramowitz and Stegun, eq. 7.2.5),
/// stable downward.
pub(crate) fn second_moment<const DEPTH: usize>(t: f64) -> f64 {
    let n = DEPTH as f64;
    // Asymptotic in n.
    let mut ratio = ((t * t + 4.0 * n + 2.0).sqrt() - t) / (2.0 * n + 1.0);
    for n in (3..=DEPTH).rev() {
        ratio = 1.0 / (t + n as f64 * ratio);
    }
    // Now I_2 / I_1.
    2.0 * ratio / (t + 2.0 * ratio)
}

#[cfg(test)]
mod tests {
    use super::second_moment;

    #[test]
    fn second_moment_is_the_integral() {
        for t in [0.0, 0.01, 0.3, 1.0, 2.5, 6.0, 30.0] {
            // Trapezoidal sums of z² p and p, p = exp(-(z + t)²/2 + t²/2).
            let (mut moment, mut mass) = (0.0, 0.0);
            let step = 2e-4 / (1.0 + t);
            for k in 0..200_000 {
                let z = f64::from(k) * step;
                let p = (-0.5 * z * z - z * t).exp() * if k == 0 { 0.5 } else { 1.0 };
                moment += z * z * p;
                mass += p;
            }
            let want = moment / mass;
            for (got, bound) in [
                (second_moment::<200>(t), 1e-7),
                (second_moment::<32>(t), 5e-6),
            ] {
                assert!((got / want - 1.0).abs() < bound, "t {t}: {got}, {want}");
            }
        }
        assert!((second_moment::<200>(1e6) * 1e12 - 2.0).abs() < 1e-9);
    }
}
