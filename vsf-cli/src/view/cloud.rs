use super::numbers::{Numbers, check_near};
use crate::field_file::FieldFile;
use anyhow::Context;
use serde::Serialize;
use vsf::core::RestPoints;
use vsf::core::nalgebra::{Point3, center};
use vsf::plot::ColorLimit;

/// Most points that are drawn: as many as turn smoothly in a browser without a graphics card.
const MOST: usize = 200_000;
/// Largest stiffness that is drawn [N/m], as in pictures.
const STIFF: f64 = 1e15;

/// The points that are drawn.
#[derive(Serialize)]
pub struct Cloud {
    /// Points there are, drawn or not.
    total: usize,
    /// Those of them that were touched; 0 where that is not known.
    touches: usize,
    /// All places in the page are relative to it [m].
    #[serde(skip)]
    pub origin_W: Point3<f64>,
    /// Typical distance between the drawn points [m].
    spacing: f64,
    /// x, y, z of each.
    points: Numbers,
    /// Whether each was touched, if that is known.
    touched: Option<Numbers>,
    /// What its color may show.
    layers: Vec<Layer>,
    /// Indices of the drawn points, increasing.
    #[serde(skip)]
    drawn: Vec<u32>,
}

/// A number of every drawn point.
#[derive(Serialize)]
struct Layer {
    name: &'static str,
    unit: &'static str,
    values: Numbers,
    /// Value at the end of the color bar.
    limit: f64,
}

impl Cloud {
    /// Points without values: a recording whose field is not known. Of none, `origin_W` is the
    /// middle.
    pub fn of_points(points: &[Point3<f64>], origin_W: Point3<f64>) -> anyhow::Result<Self> {
        Self::of(points, &[], origin_W)
    }

    /// A field; `limit` is the stiffness at the end of the color bar [N/m], the 99 % quantile by
    /// default.
    pub fn of_field(file: &FieldFile, limit: Option<f64>) -> anyhow::Result<Self> {
        let field = &file.field;
        let place = || file.path.display().to_string();
        let flags = &file.stored.touched;
        let mut cloud = Self::of(&field.points, flags, Point3::origin()).with_context(place)?;
        let quantile = ColorLimit::default();
        let stiff = limit.map_or(quantile, ColorLimit::Value);
        let of = |name, values, limit| {
            Layer::of(name, values, limit, flags, &cloud.drawn).with_context(place)
        };
        let mut layers = vec![of("stiffness", &field.stiffness, stiff)?];
        if let Some(sd) = &field.sd {
            layers.push(of("standard deviation", sd, quantile)?);
        }
        cloud.layers = layers;
        Ok(cloud)
    }

    fn of(points: &[Point3<f64>], flags: &[bool], middle_W: Point3<f64>) -> anyhow::Result<Self> {
        for (row, p_W) in points.iter().enumerate() {
            check_near(p_W, || format!("point {row}"))?;
        }
        let drawn = drawn(points.len(), flags, MOST);
        let rest = RestPoints::new(points.to_vec())?;
        let origin_W = if points.is_empty() {
            middle_W
        } else {
            let (lower, upper) = rest.bounds();
            center(&lower, &upper)
        };
        let thinned = points.len() as f64 / drawn.len().max(1) as f64;
        let places = drawn.iter().map(|&i| points[i as usize] - origin_W);
        Ok(Self {
            total: points.len(),
            touches: flags.iter().filter(|f| **f).count(),
            origin_W,
            spacing: rest.spacing() * thinned.max(1.0).cbrt(),
            points: Numbers::f32(places.flat_map(|p| [p.x, p.y, p.z])),
            touched: (!flags.is_empty())
                .then(|| Numbers::flags(drawn.iter().map(|&i| flags[i as usize]))),
            layers: Vec::new(),
            drawn,
        })
    }

    /// Number of a point among the drawn ones, if it is drawn.
    pub fn place(&self, point: u32) -> Option<u32> {
        self.drawn.binary_search(&point).ok().map(|k| k as u32)
    }

    /// What the page leaves out.
    pub fn note(&self) -> Option<String> {
        let (drawn, total) = (self.drawn.len(), self.total);
        let which = match self.touched {
            Some(_) => "touched ones first, then a random choice",
            None => "a random choice",
        };
        (drawn < total).then(|| format!("{drawn} of {total} points are drawn: {which}."))
    }
}

impl Layer {
    /// Values of touched points make the color bar, as in pictures.
    fn of(
        name: &'static str,
        values: &[f64],
        limit: ColorLimit,
        flags: &[bool],
        drawn: &[u32],
    ) -> anyhow::Result<Self> {
        if let Some(row) = values.iter().position(|v| *v > STIFF) {
            let value = values[row];
            anyhow::bail!("{name} of point {row} is {value:?} N/m, beyond 1e15 N/m");
        }
        let counts = |i: &usize| flags.get(*i).copied().unwrap_or(true);
        let counted = (0..values.len()).filter(counts).map(|i| values[i]);
        Ok(Self {
            name,
            unit: "N/m",
            values: Numbers::f32(drawn.iter().map(|&i| values[i as usize])),
            limit: limit.resolve(counted)?,
        })
    }
}

/// Indices of at most `most` of `n` points, increasing: touched ones first, and among equals a
/// choice that follows no lattice.
fn drawn(n: usize, flags: &[bool], most: usize) -> Vec<u32> {
    let mut all: Vec<u32> = (0..n as u32).collect();
    if n > most {
        let touched = |i: u32| flags.get(i as usize).copied().unwrap_or(false);
        all.select_nth_unstable_by_key(most, |&i| (!touched(i), scrambled(i)));
        all.truncate(most);
        all.sort_unstable();
    }
    all
}

/// A number that looks random and is never the same for two: the finalizer of MurmurHash3.
fn scrambled(i: u32) -> u32 {
    let i = (i ^ (i >> 16)).wrapping_mul(0x85eb_ca6b);
    let i = (i ^ (i >> 13)).wrapping_mul(0xc2b2_ae35);
    i ^ (i >> 16)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::super::numbers::tests::bytes;
    use super::*;
    use vsf::data::{StiffnessField, Table};

    fn block(n: u32) -> Vec<Point3<f64>> {
        let at = |k: u32| 0.01 * f64::from(k);
        (0..n)
            .map(|i| Point3::new(at(i % 100), at(i / 100 % 100), at(i / 10_000)))
            .collect()
    }

    #[test]
    fn a_million_points_are_thinned_evenly() {
        let points = block(1_000_000);
        let mut field = StiffnessField {
            stiffness: vec![1.0; points.len()],
            points,
            ..StiffnessField::default()
        };
        let flags = (0..1_000_000)
            .map(|i| f64::from(u8::from(i % 10 == 3)))
            .collect();
        field
            .features
            .insert("touched".to_owned(), Table::new(1, flags).unwrap());
        let cloud = Cloud::of_field(&FieldFile::new("f".into(), field).unwrap(), None).unwrap();
        assert_eq!((cloud.drawn.len(), cloud.touches), (MOST, 100_000));
        assert!(cloud.drawn.windows(2).all(|w| w[0] < w[1]));
        assert!(
            (0..1_000_000)
                .filter(|i| i % 10 == 3)
                .all(|i| cloud.place(i).is_some())
        );
        assert!(
            cloud
                .note()
                .unwrap()
                .starts_with("200000 of 1000000 points")
        );
        assert!((cloud.spacing / (0.01 * 5_f64.cbrt()) - 1.0).abs() < 1e-9);
        // Every tenth part of the rest has its share, along the lattice and across.
        let rest: Vec<u32> = cloud
            .drawn
            .iter()
            .copied()
            .filter(|i| i % 10 != 3)
            .collect();
        for part in 0..10 {
            let share = |of: &dyn Fn(u32) -> u32| rest.iter().filter(|i| of(**i) == part).count();
            for of in [&|i| i / 100_000, &|i| i / 10 % 10] as [&dyn Fn(u32) -> u32; 2] {
                assert!((9000..11_000).contains(&share(of)), "{}", share(of));
            }
        }
    }

    #[test]
    fn values_stay_with_their_points() {
        let points = block(3);
        let cloud = Cloud::of_points(&points, Point3::origin()).unwrap();
        let read = bytes(&cloud.points);
        let read: Vec<f64> = read
            .chunks_exact(4)
            .map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap())))
            .collect();
        for (p, xyz) in points.iter().zip(read.chunks_exact(3)) {
            let q = cloud.origin_W + vsf::core::nalgebra::Vector3::from_column_slice(xyz);
            assert!((q - p).norm() < 1e-8);
        }
        assert_eq!(
            (cloud.place(2), cloud.place(3), cloud.note()),
            (Some(2), None, None)
        );
        let none = Cloud::of_points(&[], Point3::new(1.0, 0.0, 0.0)).unwrap();
        assert_eq!((none.total, none.origin_W.x), (0, 1.0));
    }

    #[test]
    fn what_cannot_be_drawn_is_named() {
        let field = |x: f64, k: f64| {
            let field = StiffnessField {
                points: vec![Point3::new(x, 0.0, 0.0)],
                stiffness: vec![k],
                ..StiffnessField::default()
            };
            let error = Cloud::of_field(&FieldFile::new("f.npz".into(), field).unwrap(), None);
            format!("{:#}", error.err().unwrap())
        };
        assert!(field(1e300, 1.0).contains("f.npz: point 0 is at"));
        assert!(field(0.0, 1e99).contains("f.npz: stiffness of point 0 is 1e99"));
    }
}
