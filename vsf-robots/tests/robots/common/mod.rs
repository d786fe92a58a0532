//! Random robots, written as URDF text and as plain numbers, for comparison with the model.

use nalgebra::{Matrix3, Matrix4, Point3, Vector3};
use proptest::prelude::*;
use std::fmt::Write;
use vsf_robots::{RobotModel, UrdfOptions};

pub type V3 = [f64; 3];

#[derive(Debug, Clone)]
pub struct RandomJoint {
    pub kind: &'static str,
    /// Link that carries the joint; joint k moves link k + 1.
    pub parent: usize,
    pub xyz: V3,
    pub rpy: V3,
    pub axis: V3,
    pub mass: f64,
    pub com: V3,
    pub inertia_rpy: V3,
    pub moments: V3,
    pub state: V3,
}

impl RandomJoint {
    pub fn moves(&self) -> bool {
        self.kind != "fixed"
    }
}

#[derive(Debug, Clone)]
pub struct RandomRobot {
    pub joints: Vec<RandomJoint>,
}

fn v3(range: f64) -> impl Strategy<Value = V3> {
    prop::array::uniform3(-range..range)
}

fn random_joint() -> impl Strategy<Value = (RandomJoint, prop::sample::Index)> {
    let kinds = ["revolute", "continuous", "prismatic", "revolute", "fixed"];
    let geometry = (
        prop::sample::select(kinds.to_vec()),
        v3(0.5),
        v3(3.0),
        v3(1.0),
    );
    let body = (0.0..3.0, v3(0.2), v3(3.0), prop::array::uniform3(0.0..0.1));
    let state = (v3(2.0), any::<prop::sample::Index>());
    (geometry, body, state)
        .prop_filter("an axis", |(g, ..)| Vector3::from(g.3).norm() > 0.1)
        .prop_map(|(g, b, s)| {
            let joint = RandomJoint {
                kind: g.0,
                parent: 0,
                xyz: g.1,
                rpy: g.2,
                axis: g.3,
                mass: b.0,
                com: b.1,
                inertia_rpy: b.2,
                moments: b.3,
                state: s.0,
            };
            (joint, s.1)
        })
}

pub fn random_robot() -> impl Strategy<Value = RandomRobot> {
    prop::collection::vec(random_joint(), 1..9).prop_map(|joints| RandomRobot {
        joints: joints
            .into_iter()
            .enumerate()
            .map(|(k, (joint, parent))| RandomJoint {
                parent: parent.index(k + 1),
                ..joint
            })
            .collect(),
    })
}

impl RandomRobot {
    /// Links `l0`, `l1`, ... and joints `j0`, ..., the joints in reverse order.
    pub fn urdf(&self) -> String {
        let s = |v: &V3| format!("{} {} {}", v[0], v[1], v[2]);
        let mut text = String::from("<robot name=\"random\"><link name=\"l0\"/>");
        for (k, j) in self.joints.iter().enumerate().rev() {
            let m = &j.moments;
            write!(
                text,
                r#"<joint name="j{k}" type="{}"><origin xyz="{}" rpy="{}"/><axis xyz="{}"/>
                <parent link="l{}"/><child link="l{}"/></joint>
                <link name="l{}"><inertial><origin xyz="{}" rpy="{}"/><mass value="{}"/>
                <inertia ixx="{}" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/></inertial></link>"#,
                j.kind,
                s(&j.xyz),
                s(&j.rpy),
                s(&j.axis),
                j.parent,
                k + 1,
                k + 1,
                s(&j.com),
                s(&j.inertia_rpy),
                j.mass,
                m[0],
                m[1],
                m[2],
            )
            .unwrap();
        }
        text + "</robot>"
    }

    /// The model with its joints in the order of `self.joints`.
    pub fn model(&self) -> RobotModel {
        let names = (0..self.joints.len()).filter(|&k| self.joints[k].moves());
        let options = UrdfOptions {
            joint_order: Some(names.map(|k| format!("j{k}")).collect()),
            ..UrdfOptions::default()
        };
        RobotModel::from_urdf_str(&self.urdf(), "", &options).unwrap()
    }

    /// Positions (0), velocities (1) or accelerations (2) of the moving joints.
    pub fn state(&self, derivative: usize) -> Vec<f64> {
        let moving = self.joints.iter().filter(|j| j.moves());
        moving.map(|j| j.state[derivative]).collect()
    }

    /// Poses of `l0`, `l1`, ... by products of 4x4 matrices.
    pub fn poses(&self, q: &[f64]) -> Vec<Matrix4<f64>> {
        let mut poses = vec![Matrix4::identity()];
        let mut q = q.iter();
        for j in &self.joints {
            let axis = Vector3::from(j.axis).normalize();
            let motion = match j.kind {
                "fixed" => Matrix4::identity(),
                "prismatic" => transform(Matrix3::identity(), axis * *q.next().unwrap()),
                _ => transform(rodrigues(&axis, *q.next().unwrap()), Vector3::zeros()),
            };
            let offset = transform(rpy(&j.rpy), j.xyz.into());
            poses.push(poses[j.parent] * offset * motion);
        }
        poses
    }

    /// For each moving joint, whether it moves link `l`.
    pub fn moves_link(&self, l: usize) -> Vec<bool> {
        let mut above = vec![false; self.joints.len()];
        let mut l = l;
        while l > 0 {
            above[l - 1] = true;
            l = self.joints[l - 1].parent;
        }
        (0..self.joints.len())
            .filter(|&k| self.joints[k].moves())
            .map(|k| above[k])
            .collect()
    }
}

pub fn transform(R: Matrix3<f64>, t: Vector3<f64>) -> Matrix4<f64> {
    let mut X = Matrix4::identity();
    X.fixed_view_mut::<3, 3>(0, 0).copy_from(&R);
    X.fixed_view_mut::<3, 1>(0, 3).copy_from(&t);
    X
}

pub fn rodrigues(axis: &Vector3<f64>, angle: f64) -> Matrix3<f64> {
    let k = axis.cross_matrix();
    Matrix3::identity() + k * angle.sin() + k * k * (1.0 - angle.cos())
}

pub fn rpy(v: &V3) -> Matrix3<f64> {
    rodrigues(&Vector3::z(), v[2]) * rodrigues(&Vector3::y(), v[1]) * rodrigues(&Vector3::x(), v[0])
}

pub fn rotation(X: &Matrix4<f64>) -> Matrix3<f64> {
    X.fixed_view::<3, 3>(0, 0).into_owned()
}

pub fn apply(X: &Matrix4<f64>, p: &V3) -> Point3<f64> {
    X.transform_point(&Point3::from(*p))
}
