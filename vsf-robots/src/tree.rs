//! Turns a description into a model: all checks, and the order of links and joints.

use crate::description::{Description, JointDescription, LinkDescription};
use crate::model::{Motion, is_near};
use crate::{Joint, JointKind, Link, RobotError, RobotModel};
use nalgebra::{Isometry3, Matrix3, Point3, Unit};
use std::collections::HashMap;
use std::sync::Arc;
use vsf_core::{Collider, LinkChains};

/// Far beyond any robot. Every link stores the joints above it, so that a chain takes quadratic memory.
pub(crate) const MAX_LINKS: usize = 1000;

/// Rounding that a printed inertia may carry, relative to its largest entry.
const INERTIA_ROUNDING: f64 = 1e-9;
/// Masses (kg) and moments of inertia (kg m²) beyond any robot's, with which torques are still finite.
const MOST_MASS: f64 = 1e9;
const MOST_MOMENT: f64 = 1e15;

impl RobotModel {
    /// Checks a description and puts it in order. Joints are numbered depth-first, or as in
    /// `joint_order`.
    pub(crate) fn assemble(
        description: Description,
        joint_order: Option<&[String]>,
    ) -> Result<Self, RobotError> {
        let Description {
            name,
            links,
            joints,
            unread,
        } = description;
        let tree = Tree::new(&name, &links, &joints)?;
        let joint_of = number_joints(&tree, &joints, joint_order)?;

        let mut model_links = Vec::with_capacity(links.len());
        let mut model_joints: Vec<Option<Joint>> = vec![None; joint_of.len()];
        let mut colliders = Vec::new();
        let mut chains: Vec<Vec<u32>> = Vec::with_capacity(links.len());
        // Position of a described link in the model.
        let mut position = vec![0; links.len()];
        for (l, &described) in tree.depth_first.iter().enumerate() {
            position[described] = l;
            let link = &links[described];
            let (mut parent, mut X_PJ) = (None, Isometry3::identity());
            let (mut motion, mut chain) = (Motion::Fixed, Vec::new());
            if let Some(j) = tree.joint_above[described] {
                let joint = &joints[j];
                let p = position[tree.parent[j]];
                check_pose("origin of the joint", &joint.name, &joint.X_PJ)?;
                (parent, X_PJ) = (Some(p), joint.X_PJ);
                chain.clone_from(&chains[p]);
                if let Some(kind) = joint.kind {
                    let index = joint_of[&j];
                    motion = moving(joint, kind, index)?;
                    chain.push(index as u32);
                    model_joints[index] = Some(Joint {
                        name: joint.name.clone(),
                        kind,
                        child: l,
                        limits: joint.limits,
                    });
                }
            }
            chains.push(chain);
            model_links.push(body(link, parent, X_PJ, motion)?);
            for (X_LS, shape) in &link.shapes {
                check_pose("pose of a collision shape", &link.name, X_LS)?;
                shape.check().map_err(|source| RobotError::Shape {
                    link: link.name.clone(),
                    source,
                })?;
                colliders.push(Collider {
                    link: l,
                    X_LS: *X_LS,
                    shape: shape.clone(),
                });
            }
        }
        Ok(Self {
            name,
            chains: Arc::new(LinkChains::new(joint_of.len(), chains)?),
            links: model_links,
            joints: model_joints.into_iter().flatten().collect(),
            colliders,
            X_WB: Isometry3::identity(),
            unread,
        })
    }
}

/// How the described links are connected.
struct Tree {
    /// Described links, parents first.
    depth_first: Vec<usize>,
    /// For each described link, the joint whose child it is.
    joint_above: Vec<Option<usize>>,
    /// For each described joint, its parent link.
    parent: Vec<usize>,
}

impl Tree {
    fn new(
        robot: &str,
        links: &[LinkDescription],
        joints: &[JointDescription],
    ) -> Result<Self, RobotError> {
        if links.is_empty() {
            return Err(RobotError::NoLinks {
                robot: robot.to_owned(),
            });
        }
        let by_name = unique("link", links.iter().map(|l| &l.name))?;
        unique("joint", joints.iter().map(|j| &j.name))?;
        let find = |joint: &JointDescription, link: &String| {
            by_name
                .get(link)
                .copied()
                .ok_or_else(|| RobotError::MissingLink {
                    joint: joint.name.clone(),
                    link: link.clone(),
                })
        };

        let mut joint_above: Vec<Option<usize>> = vec![None; links.len()];
        let mut parent = Vec::with_capacity(joints.len());
        let mut joints_below: Vec<Vec<usize>> = vec![Vec::new(); links.len()];
        let mut child = Vec::with_capacity(joints.len());
        for (j, joint) in joints.iter().enumerate() {
            let (p, c) = (find(joint, &joint.parent)?, find(joint, &joint.child)?);
            if let Some(first) = joint_above[c] {
                return Err(RobotError::TwoParents {
                    link: joint.child.clone(),
                    first: joints[first].name.clone(),
                    second: joint.name.clone(),
                });
            }
            joint_above[c] = Some(j);
            joints_below[p].push(j);
            parent.push(p);
            child.push(c);
        }

        let roots: Vec<usize> = (0..links.len())
            .filter(|&l| joint_above[l].is_none())
            .collect();
        if roots.len() > 1 {
            return Err(RobotError::SeveralRoots {
                roots: roots.iter().map(|&l| links[l].name.clone()).collect(),
            });
        }
        let mut depth_first = Vec::with_capacity(links.len());
        let mut reached = vec![false; links.len()];
        let mut stack = roots;
        while let Some(l) = stack.pop() {
            depth_first.push(l);
            reached[l] = true;
            stack.extend(joints_below[l].iter().rev().map(|&j| child[j]));
        }
        if let Some(start) = reached.iter().position(|r| !r) {
            // Every link above an unreached one is unreached: climbing ends on the loop.
            let mut l = start;
            for _ in 0..links.len() {
                l = joint_above[l].map_or(l, |j| parent[j]);
            }
            return Err(RobotError::Loop {
                joint: joint_above[l].map_or(String::new(), |j| joints[j].name.clone()),
                link: links[l].name.clone(),
            });
        }
        Ok(Self {
            depth_first,
            joint_above,
            parent,
        })
    }
}

fn unique<'a>(
    what: &'static str,
    names: impl Iterator<Item = &'a String>,
) -> Result<HashMap<&'a String, usize>, RobotError> {
    let mut by_name = HashMap::new();
    for (i, name) in names.enumerate() {
        if by_name.insert(name, i).is_some() {
            return Err(RobotError::DuplicateName {
                what,
                name: name.clone(),
            });
        }
    }
    Ok(by_name)
}

/// Maps each described moving joint to its index in joint vectors.
fn number_joints(
    tree: &Tree,
    joints: &[JointDescription],
    order: Option<&[String]>,
) -> Result<HashMap<usize, usize>, RobotError> {
    let moving: Vec<usize> = tree
        .depth_first
        .iter()
        .filter_map(|&l| tree.joint_above[l])
        .filter(|&j| joints[j].kind.is_some())
        .collect();
    let Some(order) = order else {
        return Ok(moving.iter().enumerate().map(|(i, &j)| (j, i)).collect());
    };
    let wanted = unique("joint order entry", order.iter())?;
    let names = |js: &[usize]| js.iter().map(|&j| joints[j].name.clone()).collect();
    if let Some(unknown) = order
        .iter()
        .find(|name| !moving.iter().any(|&j| joints[j].name == **name))
    {
        return Err(RobotError::UnknownJoint {
            name: unknown.clone(),
            known: names(&moving),
        });
    }
    let missing: Vec<usize> = moving
        .iter()
        .copied()
        .filter(|&j| !wanted.contains_key(&joints[j].name))
        .collect();
    if !missing.is_empty() {
        return Err(RobotError::IncompleteJointOrder {
            missing: names(&missing),
        });
    }
    Ok(moving
        .iter()
        .map(|&j| (j, wanted[&joints[j].name]))
        .collect())
}

fn moving(joint: &JointDescription, kind: JointKind, index: usize) -> Result<Motion, RobotError> {
    let limits = &joint.limits;
    let ordered = limits.lower <= limits.upper;
    if !(ordered && limits.effort >= 0.0 && limits.velocity >= 0.0) {
        return Err(RobotError::Limits {
            joint: joint.name.clone(),
            lower: limits.lower,
            upper: limits.upper,
            effort: limits.effort,
            velocity: limits.velocity,
        });
    }
    // Scaled first, so that neither huge nor tiny axes over- or underflow in the norm.
    let largest = joint.axis_J.amax();
    let axis_J = Unit::try_new(joint.axis_J / largest, 0.5)
        .filter(|a| largest.is_finite() && a.iter().all(|v| v.is_finite()))
        .ok_or_else(|| RobotError::Axis {
            joint: joint.name.clone(),
            axis: joint.axis_J.into(),
        })?;
    Ok(match kind {
        JointKind::Revolute | JointKind::Continuous => Motion::Revolute {
            joint: index,
            axis_J,
        },
        JointKind::Prismatic => Motion::Prismatic {
            joint: index,
            axis_J,
        },
    })
}

fn body(
    link: &LinkDescription,
    parent: Option<usize>,
    X_PJ: Isometry3<f64>,
    motion: Motion,
) -> Result<Link, RobotError> {
    check_pose("inertial origin", &link.name, &link.X_LI)?;
    if !(0.0..=MOST_MASS).contains(&link.mass) {
        return Err(RobotError::Mass {
            link: link.name.clone(),
            mass: link.mass,
        });
    }
    if let Some(moment) = odd_moment(&link.inertia_I) {
        return Err(RobotError::Inertia {
            link: link.name.clone(),
            moment,
        });
    }
    let R = link.X_LI.rotation.to_rotation_matrix();
    Ok(Link {
        name: link.name.clone(),
        parent,
        X_PJ,
        motion,
        mass: link.mass,
        com_L: Point3::from(link.X_LI.translation.vector),
        inertia_L: R.matrix() * link.inertia_I * R.matrix().transpose(),
    })
}

/// A principal moment that is negative beyond rounding, or an entry that is not finite or too large.
fn odd_moment(inertia: &Matrix3<f64>) -> Option<f64> {
    if let Some(&bad) = inertia
        .iter()
        .find(|v| !(0.0..=MOST_MOMENT).contains(&v.abs()))
    {
        return Some(bad);
    }
    // Scaled to 1, so that the eigenvalue iteration stays in range.
    let scale = inertia.amax().max(f64::MIN_POSITIVE);
    let moment = (inertia / scale).symmetric_eigenvalues().min() * scale;
    Some(moment).filter(|m| *m < -INERTIA_ROUNDING * inertia.amax())
}

fn check_pose(what: &'static str, name: &str, X: &Isometry3<f64>) -> Result<(), RobotError> {
    if is_near(X) {
        Ok(())
    } else {
        Err(RobotError::Pose {
            what,
            name: name.to_owned(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::JointLimits;
    use nalgebra::Vector3;

    #[test]
    fn axes_of_any_length_are_directions() {
        let mut joint = JointDescription {
            name: "j".into(),
            kind: Some(JointKind::Revolute),
            parent: "a".into(),
            child: "b".into(),
            X_PJ: Isometry3::identity(),
            axis_J: Vector3::zeros(),
            limits: JointLimits::NONE,
        };
        for length in [1e-300, 1.0, 1e300] {
            joint.axis_J = Vector3::new(0.0, 3.0, 4.0) * length;
            let Ok(Motion::Revolute { axis_J, .. }) = moving(&joint, JointKind::Revolute, 0) else {
                panic!("refused {length}")
            };
            assert!((axis_J.into_inner() - Vector3::new(0.0, 0.6, 0.8)).norm() < 1e-15);
        }
        for bad in [0.0, f64::NAN, f64::INFINITY] {
            joint.axis_J = Vector3::new(bad, 0.0, 0.0);
            assert!(moving(&joint, JointKind::Revolute, 0).is_err());
            joint.axis_J = Vector3::new(bad, 0.0, bad);
            assert!(moving(&joint, JointKind::Revolute, 0).is_err());
        }
        joint.axis_J = Vector3::new(f64::NAN, 1.0, 0.0);
        assert!(moving(&joint, JointKind::Revolute, 0).is_err());
    }

    #[test]
    fn a_moment_is_found_at_any_scale() {
        for scale in [1e-320, 1e-12, 1.0, 1e14] {
            let inertia =
                |least: f64| Matrix3::from_diagonal(&Vector3::new(3.0, least, 5.0)) * scale;
            assert_eq!(odd_moment(&inertia(2.0)), None, "{scale:e}");
            let moment = odd_moment(&inertia(-2.0)).unwrap();
            assert!((moment / scale + 2.0).abs() < 1e-2, "{moment:e}");
        }
        assert!(odd_moment(&Matrix3::from_element(f64::NAN)).is_some());
        assert_eq!(odd_moment(&Matrix3::zeros()), None);
    }
}
