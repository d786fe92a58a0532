//! Readings in contact beside the torques of springs of one stiffness everywhere, which those of any stiffness are like,
//! by and large: signs and columns. One joint alone is so only if its points pull the same way.

use super::{PipelineWarning, springs};
use crate::{Scene, Trace};

/// Readings that are less like those of springs are of the other sign; those of one joint, which may go against the others
/// where stiffness differs much from place to place, from further on.
const OPPOSITE: f64 = -0.5;
const ONE_OPPOSITE: f64 = -0.7;
/// Share of the squared torques of springs below which a joint feels too little to be judged.
const LEAST_SHARE: f64 = 0.03;
/// Share of the pulls of single points that is left of them together, below which they pull a joint both ways.
const ONE_WAY: f64 = 0.8;
/// How much the others have to be like springs where one joint is not.
const OTHERS: f64 = 0.5;
/// Another order of columns has to be like springs where the order given is not, or leave less than this share of what
/// that leaves of the squared readings. Where stiffness differs much, wrong orders are somewhat better, too.
const ORDER: f64 = 0.6;
const NO_ORDER: f64 = 0.3;
const MOST_LEFT: f64 = 0.1;

/// Torques of the wrong sign, of all joints or of one, and columns in the wrong order.
pub fn warning(scene: &Scene, traces: &[Trace]) -> Option<PipelineWarning> {
    let products = Products::new(scene, traces);
    let joints = products.springs.len();
    let own: Vec<usize> = (0..joints).collect();
    let correlation = products.correlation(&own);
    let name = |j: usize| scene.robot().joints()[j].name();
    let one_joint = || {
        (0..joints).find_map(|j| {
            let (correlation, others) = products.apart(j)?;
            (correlation < ONE_OPPOSITE && others > OTHERS).then(|| {
                PipelineWarning::OppositeJoint {
                    joint: name(j).to_owned(),
                    correlation,
                }
            })
        })
    };
    if correlation < OPPOSITE {
        // One that feels nearly all makes for the whole.
        let all = PipelineWarning::OppositeTorques { correlation };
        return Some(one_joint().unwrap_or(all));
    }
    let orders = orders(joints).map(|(order, columns)| (order, products.correlation(&columns)));
    let best = orders.max_by(|a, b| a.1.total_cmp(&b.1));
    if let Some((order, other)) = best.filter(|(_, c)| is_better(*c, correlation)) {
        let order = match order {
            Order::Reversed => "in reverse order".to_owned(),
            Order::Turned(by) => format!("turned on ({} in the column of {})", name(0), name(by)),
            Order::Exchanged(a, b) => format!("of {} and {} exchanged", name(a), name(b)),
        };
        return Some(PipelineWarning::MixedColumns {
            order,
            other,
            correlation,
        });
    }
    one_joint()
}

/// Whether readings are like springs in another order of columns, rather than in their own.
fn is_better(other: f64, own: f64) -> bool {
    let left = |correlation: f64| 1.0 - correlation.max(0.0).powi(2);
    other > ORDER && (own < NO_ORDER || left(other) < MOST_LEFT * left(own))
}

/// How columns may have come into another order.
enum Order {
    Reversed,
    /// So many columns of the begin stand at the end.
    Turned(usize),
    Exchanged(usize, usize),
}

/// Such orders, with the column that each joint then takes.
fn orders(joints: usize) -> impl Iterator<Item = (Order, Vec<usize>)> {
    let own = move || (0..joints).collect::<Vec<_>>();
    let reversed = (Order::Reversed, (0..joints).rev().collect());
    let turned = (1..joints).map(move |by| {
        let mut columns = own();
        columns.rotate_left(by);
        (Order::Turned(by), columns)
    });
    let pairs = (0..joints).flat_map(move |a| (a + 1..joints).map(move |b| (a, b)));
    let exchanged = pairs.map(move |(a, b)| {
        let mut columns = own();
        columns.swap(a, b);
        (Order::Exchanged(a, b), columns)
    });
    exchanged.chain(turned).chain(std::iter::once(reversed))
}

/// Inner products of the torques of springs and of readings in contact.
struct Products {
    /// By joint and column.
    both: Vec<Vec<f64>>,
    springs: Vec<f64>,
    readings: Vec<f64>,
    /// Sums of the sizes of the torques of springs, and of those of their points.
    net: Vec<f64>,
    gross: Vec<f64>,
}

impl Products {
    fn new(scene: &Scene, traces: &[Trace]) -> Self {
        let joints = scene.robot().joint_count();
        let mut found = Self {
            both: vec![vec![0.0; joints]; joints],
            springs: vec![0.0; joints],
            readings: vec![0.0; joints],
            net: vec![0.0; joints],
            gross: vec![0.0; joints],
        };
        let observations = traces.iter().flat_map(|t| &t.observations);
        for obs in observations.filter(|o| !o.is_empty()) {
            for (j, spring) in springs(obs).enumerate() {
                found.springs[j] += spring * spring;
                found.net[j] += spring.abs();
                found.gross[j] += obs.row(j).iter().map(|w| w.abs()).sum::<f64>();
                found.readings[j] += obs.reading()[j].powi(2);
                let products = found.both[j].iter_mut().zip(obs.reading());
                products.for_each(|(both, reading)| *both += spring * reading);
            }
        }
        found
    }

    /// Of all joints, each with the column that it is given; NaN where one of both is zero.
    fn correlation(&self, columns: &[usize]) -> f64 {
        let both = columns.iter().enumerate().map(|(j, k)| self.both[j][*k]);
        let sum = |of: &[f64]| of.iter().sum::<f64>();
        both.sum::<f64>() / (sum(&self.springs) * sum(&self.readings)).sqrt()
    }

    /// Of one joint that feels enough, one way, and of all others.
    fn apart(&self, j: usize) -> Option<(f64, f64)> {
        let all = self.springs.iter().sum::<f64>();
        let enough = self.springs[j] > LEAST_SHARE * all
            && self.net[j] > ONE_WAY * self.gross[j]
            && self.readings[j] > 0.0;
        let without = |of: &[f64]| of.iter().sum::<f64>() - of[j];
        let both: f64 = (0..self.springs.len()).map(|k| self.both[k][k]).sum();
        let own = self.both[j][j] / (self.springs[j] * self.readings[j]).sqrt();
        let others =
            (both - self.both[j][j]) / (without(&self.springs) * without(&self.readings)).sqrt();
        enough.then_some((own, others))
    }
}
