use crate::link_pose::{LinkPose, beyond};
use nalgebra::{Matrix3, Point3, Vector3};

/// A link whose box overlaps that of another link, the owner, and which may take over the owner's points.
#[derive(Debug, Clone)]
pub(crate) struct Rival {
    pub slot: usize,
    /// Pose of the owner in the rival's frame.
    R_RL: Matrix3<f64>,
    p_RL: Vector3<f64>,
    /// The box around the rival's box in the owner's frame.
    center_L: Point3<f64>,
    half_L: Vector3<f64>,
}

impl Rival {
    /// Writes the rivals of every link.
    pub fn find(poses: &[LinkPose], rivals: &mut Vec<Vec<Self>>) {
        rivals.resize_with(poses.len(), Vec::new);
        for (slot, (owner, rivals)) in poses.iter().zip(rivals).enumerate() {
            rivals.clear();
            for (rival_slot, rival) in poses.iter().enumerate() {
                if slot != rival_slot {
                    rivals.extend(Self::new(owner, rival, rival_slot));
                }
            }
        }
    }

    /// `None` when the boxes are apart.
    fn new(owner: &LinkPose, rival: &LinkPose, slot: usize) -> Option<Self> {
        let R_RL = rival.R_WL.tr_mul(&owner.R_WL);
        let center_L = owner.to_link(&rival.center_W);
        let half_L = R_RL.transpose().abs() * rival.half_L;
        let apart = beyond(&center_L, &owner.center_L, &(half_L + owner.half_L));
        (apart <= 0.0).then(|| Self {
            slot,
            R_RL,
            p_RL: rival.R_WL.tr_mul(&(owner.p_WL - rival.p_WL)),
            center_L,
            half_L,
        })
    }

    /// A place of the owner in the rival's frame.
    #[inline]
    pub fn place(&self, p_L: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.R_RL * p_L.coords + self.p_RL)
    }

    /// A place of the owner in the rival's frame, if it is in the rival's box.
    #[inline]
    pub fn place_in_box(&self, p_L: &Point3<f64>, rival: &LinkPose) -> Option<Point3<f64>> {
        if beyond(p_L, &self.center_L, &self.half_L) > 0.0 {
            return None;
        }
        let p_R = self.place(p_L);
        (rival.outside(&p_R) <= 0.0).then_some(p_R)
    }
}
