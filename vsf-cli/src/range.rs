//! What the values of flags may be. Squares and products of the numbers are finite.

use crate::exit::usage;
use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::str::FromStr;
use vsf::core::RestPoints;
use vsf::core::nalgebra::Point3;

const MOST: f64 = 1e100;

/// A number > 0.
pub fn positive(text: &str) -> Result<f64, String> {
    let range = 1.0 / MOST..=MOST;
    ranged(text, range, "a number > 0, from 1e-100 to 1e100")
}

/// Minutes of a run, a hundred years at most.
pub fn minutes(text: &str) -> Result<f64, String> {
    ranged(text, 1e-4..=5.2e7, "a number from 1e-4 to 5.2e7 min")
}

/// A length > 0 [m] on the scale of what is touched.
pub fn length(text: &str) -> Result<f64, String> {
    ranged(text, 1e-9..=1.0, "a length > 0, from 1e-9 to 1 m")
}

/// A length of either sign [m].
pub fn offset(text: &str) -> Result<f64, String> {
    ranged(text, -1.0..=1.0, "a length from -1 to 1 m")
}

/// Times a second.
pub fn rate(text: &str) -> Result<f64, String> {
    ranged(text, 1e-3..=1e6, "a number from 0.001 to 1e6 Hz")
}

/// A number >= 0.
pub fn not_negative(text: &str) -> Result<f64, String> {
    ranged(text, 0.0..=MOST, "a number >= 0 and at most 1e100")
}

/// A standard deviation > 0, far from where the numbers that follow from it leave what a file may hold.
pub fn deviation(text: &str) -> Result<f64, String> {
    ranged(text, 1e-12..=1e12, "a number > 0, from 1e-12 to 1e12")
}

/// A standard deviation of readings, or 0: readings of more than 1e12 are taken from no file.
pub fn scatter(text: &str) -> Result<f64, String> {
    ranged(text, 0.0..=1e9, "a number >= 0 and at most 1e9")
}

/// A deviation per another one.
pub fn share(text: &str) -> Result<f64, String> {
    ranged(text, 0.0..=1e6, "a number >= 0 and at most 1e6")
}

/// A probability of more than one in two.
pub fn confidence(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|p| (0.5..1.0).contains(p));
    value.ok_or_else(|| "must be a number from 0.5 to below 1".to_owned())
}

/// A number of either sign.
pub fn finite(text: &str) -> Result<f64, String> {
    ranged(text, -MOST..=MOST, "a number of at most 1e100 in magnitude")
}

/// Spacing of a grid over a part of a robot [m].
pub fn spacing(text: &str) -> Result<f64, String> {
    ranged(text, 1e-6..=1.0, "a number from 1e-6 to 1 m")
}

/// Replays per update; each costs as much as an update.
pub fn replays(text: &str) -> Result<usize, String> {
    let value = text.parse().ok().filter(|n| *n <= 10_000);
    value.ok_or_else(|| "must be a whole number up to 10000".to_owned())
}

/// A whole number >= 1.
pub fn count(text: &str) -> Result<usize, String> {
    let value = text.parse().ok().filter(|n| *n > 0);
    value.ok_or_else(|| "must be a whole number >= 1".to_owned())
}

/// A seed of random draws.
pub fn seed(text: &str) -> Result<u64, String> {
    whole(0..=u64::MAX)(text)
}

/// A whole number of a range.
pub fn whole<T: FromStr + PartialOrd + Display>(
    range: RangeInclusive<T>,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static
where
    RangeInclusive<T>: Clone + Send + Sync + 'static,
{
    move |text| {
        let value = text.parse().ok().filter(|n| range.contains(n));
        let words = || {
            format!(
                "must be a whole number from {} to {}",
                range.start(),
                range.end()
            )
        };
        value.ok_or_else(words)
    }
}

fn ranged(text: &str, range: RangeInclusive<f64>, words: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|v| range.contains(v));
    value.ok_or_else(|| format!("must be {words}"))
}

/// Paths that end so, as an output that is no other kind of file by mistake.
pub fn ending(
    ending: &'static str,
) -> impl Fn(&str) -> Result<PathBuf, String> + Clone + Send + Sync + 'static {
    move |text| {
        let path = PathBuf::from(text);
        if (path.extension()).is_some_and(|e| e.eq_ignore_ascii_case(ending)) {
            Ok(path)
        } else {
            Err(format!("must end in .{ending}"))
        }
    }
}

/// Refuses a spacing of points (m) that is longer than a box (m).
pub fn fits(spacing: f64, [lower, upper]: &[Point3<f64>; 2]) -> anyhow::Result<()> {
    let size = (upper - lower).max();
    if spacing > size {
        Err(usage(format!(
            "--spacing {spacing:?} is more than the box, {size:?} m; lengths are in meters"
        )))
    } else {
        Ok(())
    }
}

/// Lower and upper corner of a box (m), of the six numbers of `--box`.
pub fn corners(given: &[f64]) -> anyhow::Result<[Point3<f64>; 2]> {
    let [ax, ay, az, bx, by, bz] = *given else {
        let count = given.len();
        return Err(usage(format!("--box takes 6 numbers, {count} given")));
    };
    let (a, b) = (Point3::new(ax, ay, az), Point3::new(bx, by, bz));
    if let Some(far) = given.iter().find(|c| c.abs() > RestPoints::FARTHEST) {
        Err(usage(format!(
            "--box: {far:e} m is beyond 1e6 m; check units"
        )))
    } else if (a - b).iter().any(|edge| *edge == 0.0) {
        Err(usage(
            "--box has an edge of length 0; it takes two opposite corners, x,y,z,x,y,z [m]",
        ))
    } else {
        Ok([a.inf(&b), a.sup(&b)])
    }
}
