use vsf_core::{CoreError, Noise, Observation};

/// The one stiffness (N/m, >= 0) that explains readings best when all points have it in the proportions of a
/// `shape`: `K_i = level * shape_i`, by least squares, each channel counted by its own noise: that of the observation, or
/// `noise` where one is given for all.
///
/// Readings are sums over many points, so that their common level is what touches tell most
/// surely, and is right where the stiffnesses of single points are not.
///
/// # Errors
/// An observation that reaches beyond the shape, or of another number of channels than `noise`, readings that no point of the
/// shape bears on.
pub fn fit_level<'a>(
    shape: &[f64],
    observations: impl IntoIterator<Item = &'a Observation<f64>>,
    noise: Option<&Noise>,
) -> Result<f64, CoreError> {
    CoreError::check_finite("shape", shape)?;
    let (mut cross, mut square) = (0.0, 0.0);
    let mut unit = Vec::new();
    for obs in observations.into_iter().filter(|o| !o.is_empty()) {
        obs.check_fits(shape.len())?;
        let noise = noise.unwrap_or(obs.noise());
        CoreError::check_len("noise", noise.dim(), obs.dim())?;
        unit.clear();
        unit.resize(obs.dim(), 0.0);
        obs.apply(shape, &mut unit);
        for (i, (a, b)) in unit.iter().zip(obs.reading()).enumerate() {
            let weight = noise.sd(i).powi(-2);
            cross += weight * a * b;
            square += weight * a * a;
        }
    }
    if !(square > 0.0 && square.is_finite()) {
        return Err(CoreError::Parameter {
            name: "weight of the shape in the readings",
            value: square,
            range: "> 0: some touched point must have a part in it",
        });
    }
    Ok((cross / square).max(0.0))
}
