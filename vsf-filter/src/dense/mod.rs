//! Exact Gaussian filters over the touched points. [`touched`] conditions the prior of points that are
//! touched late on earlier ones, [`joint`] extends a posterior of the touched points to all others.
//! [`information`] is eq. 5 of the paper with matrices of `faer`. [`covariance`] is the fast form:
//! [`tiles`] hold the matrix, [`product`] multiplies it, [`square`] has the inner loops. [`mode`] follows
//! the constrained optimum by [`columns`] of the matrix, [`pivoting`] finds it exactly.

mod algebra;
mod channels;
mod columns;
mod covariance;
mod gain;
mod information;
mod innovation;
mod joint;
mod mode;
mod pivoting;
mod product;
mod projection;
mod square;
mod tiles;
mod touched;

pub use covariance::CovarianceFilter;
pub use information::InformationFilter;
pub use joint::JointEstimator;
pub use projection::Projection;
