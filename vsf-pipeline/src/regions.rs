//! Finds stiff regions of a field: groups of points that stand out from the rest, like inclusions in
//! tissue.

use nalgebra::{Point3, Vector3};
use std::collections::HashMap;
use vsf_core::{Belief, CoreError, RestPoints, median};

/// Criteria for stiff regions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegionOptions {
    /// Stiffness from which a point is stiff, as a multiple of the background; above 0, default 2.
    pub contrast: f64,
    /// Minimum probability that a point is at least that stiff, judged for each point by itself; 0.5 to
    /// below 1, default 0.95.
    pub confidence: f64,
    /// Distance (m) up to which stiff points belong together. Default: 1.8 times the
    /// [`RestPoints::spacing`] of the points considered, which joins neighbors on a lattice, including
    /// diagonal ones.
    pub reach: Option<f64>,
    /// Minimum number of points of a region; at least 1, default 3. Single points are the least certain of
    /// a field: deep ones, which are hardly felt, absorb what others leave unexplained.
    pub fewest: usize,
}

impl Default for RegionOptions {
    fn default() -> Self {
        Self {
            contrast: 2.0,
            confidence: 0.95,
            reach: None,
            fewest: 3,
        }
    }
}

/// The stiff regions of a field.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct StiffRegions {
    /// Number of points considered.
    pub looked_at: usize,
    /// Number of those with a stiffness above 0.
    pub felt: usize,
    /// The background (N/m): the median stiffness of the points with a stiffness above 0; `None` if there
    /// are none.
    pub background: Option<f64>,
    /// Stiffness (N/m) from which a point is stiff.
    pub stiff_from: Option<f64>,
    /// Distance up to which stiff points belong together (m).
    pub reach: f64,
    /// The regions, in decreasing order of total stiffness.
    pub regions: Vec<StiffRegion>,
    /// Number of stiff points in groups too small for a region.
    pub scattered: usize,
    /// Increasing indices of points whose mean is above [`stiff_from`](Self::stiff_from), but not with the
    /// [confidence](RegionOptions::confidence) required, since their deviation is too large.
    pub unsure: Vec<usize>,
}

/// One stiff region.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct StiffRegion {
    /// Indices of its points, in increasing order.
    pub points: Vec<usize>,
    /// Center of its points, weighted by stiffness (m, world frame).
    pub center: Point3<f64>,
    /// Smallest and largest corner of the bounding box of its points (m, world frame).
    pub bounds: [Point3<f64>; 2],
    /// Mean stiffness of its points (N/m).
    pub mean: f64,
    /// Upper bound of the standard deviation of that mean (N/m): the mean of the deviations of the points.
    /// It is exact if their errors are fully correlated. For a belief without deviations it is next to
    /// nothing.
    pub sd: f64,
    /// Stiffness of its stiffest point (N/m).
    pub largest: f64,
}

/// Finds the regions of a field that are stiffer than its background.
///
/// `touched` flags the points to consider, those whose stiffness was felt; if it is empty, all are
/// considered. Where variances are next to nothing, the means alone decide. Takes O(N) time for a reach of
/// some spacings of the points.
///
/// # Errors
/// [`CoreError::Length`] for a belief or a `touched` of another number of points, [`CoreError::Parameter`]
/// for options out of range.
///
/// ```
/// use nalgebra::Point3;
/// use vsf_core::{Belief, RestPoints};
/// use vsf_pipeline::stiff_regions;
///
/// // A row of points 1 cm apart, of which the fifth to the seventh are stiff.
/// let rest = RestPoints::new((0..10).map(|k| Point3::new(0.01 * f64::from(k), 0.0, 0.0)).collect())?;
/// let stiffness = [5.0, 5.0, 5.0, 5.0, 40.0, 50.0, 40.0, 5.0, 5.0, 5.0];
/// let found = stiff_regions(&rest, &Belief::new(stiffness.to_vec(), vec![4.0; 10])?, &[], &Default::default())?;
/// assert_eq!(found.background, Some(5.0));
/// assert_eq!(found.regions[0].points, [4, 5, 6]);
/// assert!((found.regions[0].center.x - 0.05).abs() < 1e-9);
/// # Ok::<(), vsf_core::CoreError>(())
/// ```
pub fn stiff_regions(
    rest: &RestPoints,
    belief: &Belief<f64>,
    touched: &[bool],
    options: &RegionOptions,
) -> Result<StiffRegions, CoreError> {
    CoreError::check_len("the belief", belief.len(), rest.len())?;
    if !touched.is_empty() {
        CoreError::check_len("touched", touched.len(), rest.len())?;
    }
    options.check()?;
    let (mean, variance) = (belief.mean(), belief.variance());
    let looked_at: Vec<usize> = (0..rest.len())
        .filter(|i| touched.is_empty() || touched[*i])
        .collect();
    let reach = match options.reach {
        Some(reach) => reach,
        None => {
            let points = looked_at.iter().map(|i| rest.positions()[*i]);
            NEIGHBORS * RestPoints::new(points.collect())?.spacing()
        }
    };
    let felt: Vec<f64> = (looked_at.iter().map(|i| mean[*i]))
        .filter(|k| *k > 0.0)
        .collect();
    let count = felt.len();
    let background = median(felt);
    let stiff_from = background.map(|background| options.contrast * background);
    let is_stiff = |i: &usize| {
        stiff_from.is_some_and(|from| {
            probability_below((mean[*i] - from) / variance[*i].sqrt()) >= options.confidence
        })
    };
    let likely = |i: &usize| stiff_from.is_some_and(|from| mean[*i] > from);
    let stiff: Vec<usize> = looked_at.iter().copied().filter(is_stiff).collect();
    let unsure = looked_at
        .iter()
        .copied()
        .filter(|i| likely(i) && !is_stiff(i));
    let (large, small): (Vec<_>, Vec<_>) = groups(rest.positions(), stiff, reach)
        .into_iter()
        .partition(|group| group.len() >= options.fewest);
    let mut regions: Vec<StiffRegion> = (large.into_iter())
        .map(|points| StiffRegion::of(points, rest, belief))
        .collect();
    let in_all = |r: &StiffRegion| r.mean * r.points.len() as f64;
    regions.sort_by(|a, b| in_all(b).total_cmp(&in_all(a)));
    Ok(StiffRegions {
        looked_at: looked_at.len(),
        felt: count,
        background,
        stiff_from,
        reach,
        scattered: small.iter().map(Vec::len).sum(),
        unsure: unsure.collect(),
        regions,
    })
}

/// Neighbors on a cubic lattice are up to the root of 3 spacings apart.
const NEIGHBORS: f64 = 1.8;
/// Smallest edge of a cell (m), by which all coordinates of points can be counted.
const LEAST_CELL: f64 = 1e-9;

impl RegionOptions {
    fn check(&self) -> Result<(), CoreError> {
        let is_length = |v: f64| v > 0.0 && v.is_finite();
        let range = |name: &'static str, value: f64, range: &'static str| CoreError::Parameter {
            name,
            value,
            range,
        };
        if !is_length(self.contrast) {
            return Err(range("contrast", self.contrast, "above 0 and finite"));
        }
        if !(0.5..1.0).contains(&self.confidence) {
            return Err(range("confidence", self.confidence, "0.5 to below 1"));
        }
        if let Some(reach) = self.reach.filter(|r| !is_length(*r)) {
            return Err(range("reach", reach, "above 0 m and finite"));
        }
        if self.fewest == 0 {
            return Err(range("fewest", 0.0, "1 and more"));
        }
        Ok(())
    }
}

impl StiffRegion {
    /// Of its points, of which there is one at least, all with a stiffness above 0.
    fn of(points: Vec<usize>, rest: &RestPoints, belief: &Belief<f64>) -> Self {
        let n = points.len() as f64;
        let at = |i: usize| rest.positions()[i];
        let stiffness = |i: usize| belief.mean()[i];
        let all: f64 = points.iter().map(|i| stiffness(*i)).sum();
        // About the first point, so that nothing is lost to a cloud that lies far off.
        let first = at(points[0]);
        let moments = points.iter().map(|i| (at(*i) - first) * stiffness(*i));
        let corner = |of: fn(&Point3<f64>, &Point3<f64>) -> Point3<f64>| {
            points.iter().fold(first, |corner, i| of(&corner, &at(*i)))
        };
        let deviation = |i: usize| belief.variance()[i].sqrt();
        Self {
            center: first + moments.sum::<Vector3<f64>>() / all,
            bounds: [corner(Point3::inf), corner(Point3::sup)],
            mean: all / n,
            sd: points.iter().map(|i| deviation(*i)).sum::<f64>() / n,
            largest: points.iter().map(|i| stiffness(*i)).fold(0.0, f64::max),
            points,
        }
    }
}

/// Probability that a standard normal variable is below `x`.
fn probability_below(x: f64) -> f64 {
    0.5 * libm::erfc(-x / std::f64::consts::SQRT_2)
}

/// Points of these, increasing, that are linked by steps of at most `reach`, each group increasing.
fn groups(positions: &[Point3<f64>], points: Vec<usize>, reach: f64) -> Vec<Vec<usize>> {
    // Cells of the size of the reach hold the points that are in no group yet: each is taken out once.
    let size = reach.max(LEAST_CELL) * (1.0 + 1e-9);
    let cell = |p: &Point3<f64>| [p.x, p.y, p.z].map(|c| (c / size).floor() as i64);
    let mut open: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
    for &i in &points {
        open.entry(cell(&positions[i])).or_default().push(i);
    }
    let mut groups = Vec::new();
    for start in points {
        let own = open.entry(cell(&positions[start])).or_default();
        let Some(place) = own.iter().position(|i| *i == start) else {
            continue;
        };
        let mut group = vec![own.swap_remove(place)];
        let mut next = 0;
        while let Some(&i) = group.get(next) {
            next += 1;
            let p = positions[i];
            let [x, y, z] = cell(&p);
            for k in 0..27 {
                let at = [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1];
                if let Some(others) = open.get_mut(&at) {
                    let is_near = |i: &mut usize| (positions[*i] - p).norm() <= reach;
                    group.extend(others.extract_if(.., is_near));
                }
            }
        }
        group.sort_unstable();
        groups.push(group);
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cloud(points: &[[f64; 3]]) -> RestPoints {
        RestPoints::new(points.iter().map(|p| Point3::from(*p)).collect()).unwrap()
    }

    /// By merging pairs until nothing changes.
    fn merged(points: &[[f64; 3]], open: &[bool], reach: f64) -> Vec<Vec<usize>> {
        let mut label: Vec<usize> = (0..points.len()).collect();
        let near = |i: usize, k: usize| {
            open[i]
                && open[k]
                && (Point3::from(points[i]) - Point3::from(points[k])).norm() <= reach
        };
        let mut changed = true;
        while changed {
            changed = false;
            for i in 0..points.len() {
                for k in 0..points.len() {
                    if near(i, k) && label[k] < label[i] {
                        label[i] = label[k];
                        changed = true;
                    }
                }
            }
        }
        let of = |l: usize| {
            (0..points.len())
                .filter(|i| open[*i] && label[*i] == l)
                .collect()
        };
        let groups = (0..points.len()).map(of);
        groups.filter(|g: &Vec<usize>| !g.is_empty()).collect()
    }

    proptest! {
        #[test]
        fn val_groups_are_those_of_brute_force(
            points in prop::collection::vec((prop::array::uniform3(-0.1..0.1), any::<bool>()), 0..80),
            reach in 0.005..0.1,
        ) {
            let (points, open): (Vec<[f64; 3]>, Vec<bool>) = points.into_iter().unzip();
            let all = cloud(&points);
            let stiff = (0..points.len()).filter(|i| open[*i]).collect();
            let found = groups(all.positions(), stiff, reach);
            prop_assert_eq!(found, merged(&points, &open, reach));
        }
    }

    /// Quantiles of the standard normal distribution from tables.
    #[test]
    fn val_probability_of_a_normal_variable() {
        for (x, p) in [
            (0.0, 0.5),
            (1.6448536269514722, 0.95),
            (-1.959963984540054, 0.025),
        ] {
            assert!((probability_below(x) - p).abs() < 1e-12);
        }
        assert_eq!(probability_below(f64::INFINITY), 1.0);
    }

    fn row() -> (RestPoints, Vec<f64>) {
        let points: Vec<[f64; 3]> = (0..9).map(|k| [1e-3 * f64::from(k), 0.0, 0.5]).collect();
        (
            cloud(&points),
            vec![4.0, 4.0, 30.0, 10.0, 30.0, 4.0, 4.0, 4.0, 90.0],
        )
    }

    #[test]
    fn certain_points_next_to_each_other_are_a_region() {
        let (rest, mean) = row();
        let of = |sd: f64, touched: &[bool], options: &RegionOptions| {
            let belief = Belief::new(mean.clone(), vec![sd * sd; mean.len()]).unwrap();
            stiff_regions(&rest, &belief, touched, options).unwrap()
        };
        let found = of(1.0, &[], &RegionOptions::default());
        assert_eq!(
            (found.background, found.stiff_from, found.scattered),
            (Some(4.0), Some(8.0), 1)
        );
        let [region] = &found.regions[..] else {
            panic!("{found:?}");
        };
        assert_eq!(region.points, [2, 3, 4]);
        assert!((region.center - Point3::new(3e-3, 0.0, 0.5)).norm() < 1e-12);
        assert_eq!(
            region.bounds,
            [Point3::new(2e-3, 0.0, 0.5), Point3::new(4e-3, 0.0, 0.5)]
        );
        assert!((region.mean - 70.0 / 3.0).abs() < 1e-12 && region.sd == 1.0);
        assert_eq!(region.largest, 30.0);
        // The middle one is no more certain, and 1.8 spacings do not reach across it.
        let unsure = of(3.0, &[], &RegionOptions::default());
        assert!(unsure.regions.is_empty() && unsure.scattered == 3 && unsure.unsure == [3]);
        assert!(found.unsure.is_empty());
        let wide = RegionOptions {
            reach: Some(2.1e-3),
            fewest: 1,
            ..RegionOptions::default()
        };
        let points = |found: StiffRegions| -> Vec<Vec<usize>> {
            found.regions.into_iter().map(|r| r.points).collect()
        };
        assert_eq!(points(of(3.0, &[], &wide)), [vec![8], vec![2, 4]]);
        // What was not touched is no finding.
        let touched: Vec<bool> = (0..9).map(|k| k < 8).collect();
        assert_eq!(points(of(3.0, &touched, &wide)), [vec![2, 4]]);
    }

    /// Untouched points that lie closer together do not say what neighbors are.
    #[test]
    fn points_that_were_not_touched_say_nothing() {
        let mut points: Vec<[f64; 3]> = (0..9).map(|k| [1e-3 * f64::from(k), 0.0, 0.0]).collect();
        points.extend((0..100).map(|k| [1e-5 * f64::from(k), 0.01, 0.0]));
        let mut mean = vec![4.0; 109];
        mean[3..6].fill(30.0);
        mean[9..].fill(1e3);
        let touched: Vec<bool> = (0..109).map(|k| k < 9).collect();
        let belief = Belief::new(mean, vec![1.0; 109]).unwrap();
        let found = stiff_regions(&cloud(&points), &belief, &touched, &Default::default()).unwrap();
        assert_eq!(
            (found.looked_at, found.felt, found.background),
            (9, 9, Some(4.0))
        );
        assert_eq!(found.regions.len(), 1);
        assert_eq!(found.regions[0].points, [3, 4, 5]);
    }

    #[test]
    fn a_field_of_zeros_has_no_regions_and_bad_input_is_refused() {
        let (rest, mean) = row();
        let belief = |k: f64, n: usize| Belief::new(vec![k; n], vec![1.0; n]).unwrap();
        let options = RegionOptions::default();
        let nothing = stiff_regions(&rest, &belief(0.0, 9), &[], &options).unwrap();
        assert!(nothing.regions.is_empty() && nothing.scattered == 0);
        let empty = stiff_regions(&cloud(&[]), &belief(0.0, 0), &[], &options).unwrap();
        assert_eq!((empty.looked_at, empty.background), (0, None));
        let belief = Belief::new(mean, vec![1.0; 9]).unwrap();
        let fails = |touched: &[bool], options: RegionOptions| {
            stiff_regions(&rest, &belief, touched, &options).is_err()
        };
        assert!(fails(&[true; 8], options));
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let reach = Some(wrong);
            assert!(fails(
                &[],
                RegionOptions {
                    contrast: wrong,
                    ..options
                }
            ));
            assert!(fails(
                &[],
                RegionOptions {
                    confidence: wrong,
                    ..options
                }
            ));
            assert!(fails(&[], RegionOptions { reach, ..options }));
        }
        assert!(fails(
            &[],
            RegionOptions {
                fewest: 0,
                ..options
            }
        ));
    }
}
