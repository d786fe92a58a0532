use vsf_core::{CoreError, Noise, Observation};

/// Fits one stiffness level (N/m, >= 0) to readings, by least squares: `K_i = level * shape_i`.
///
/// Each channel is weighted by its noise: that of the observation, or `noise` if given.
///
/// Readings are sums over many points. Touches therefore determine the common level best, and it is right
/// even where the stiffness of single points is not.
///
/// # Errors
/// An observation that reaches beyond the shape or has another number of channels than `noise`, or readings
/// to which no point of the shape contributes.
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
