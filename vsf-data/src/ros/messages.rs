//! The messages that represent recordings and fields, and their definitions.

use super::wire::{Reader, Writer};
use crate::StiffnessField;
use crate::colormap::Scale;
use nalgebra::Isometry3;

/// Nanoseconds in a second.
pub(crate) const SECOND: i64 = 1_000_000_000;

/// Latest stamp: seconds are an `int32`.
pub(crate) const LAST: i64 = i32::MAX as i64 * SECOND;

/// Name of a message type in ROS 2, and its definition with those of its parts (`ros2msg`).
pub(crate) struct Definition {
    pub name: &'static str,
    pub text: &'static str,
}

/// The end of every definition with a header.
macro_rules! header_definition {
    () => {
        "\
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"
    };
}

pub(crate) const JOINT_STATE: Definition = Definition {
    name: "sensor_msgs/msg/JointState",
    text: concat!(
        "\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
",
        header_definition!()
    ),
};

pub(crate) const POINT_CLOUD: Definition = Definition {
    name: "sensor_msgs/msg/PointCloud2",
    text: concat!(
        "\
std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense
================================================================================
MSG: sensor_msgs/PointField
uint8 INT8 = 1
uint8 UINT8 = 2
uint8 INT16 = 3
uint8 UINT16 = 4
uint8 INT32 = 5
uint8 UINT32 = 6
uint8 FLOAT32 = 7
uint8 FLOAT64 = 8
string name
uint32 offset
uint8 datatype
uint32 count
",
        header_definition!()
    ),
};

pub(crate) const TRANSFORMS: Definition = Definition {
    name: "tf2_msgs/msg/TFMessage",
    text: concat!(
        "\
geometry_msgs/TransformStamped[] transforms
================================================================================
MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
================================================================================
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Quaternion
float64 x 0
float64 y 0
float64 z 0
float64 w 1
",
        header_definition!()
    ),
};

/// The ROS version that serialized a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Version {
    /// `ros1msg`
    One,
    /// `ros2msg` in CDR
    Two,
}

impl Version {
    /// The version of joint states, from the names that an MCAP file gives to type, definition and message.
    pub fn of_joint_states(schema: &str, definition: &str, message: &str) -> Option<Self> {
        match (schema, definition, message) {
            ("sensor_msgs/msg/JointState", "ros2msg" | "ros2idl", "cdr") => Some(Self::Two),
            ("sensor_msgs/JointState", "ros1msg", "ros1") => Some(Self::One),
            _ => None,
        }
    }
}

/// Whether a definition, if the file has one, is that of joint states. The name of the type alone does not determine the
/// layout of the bytes.
pub(crate) fn defines_joint_states(text: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(text) else {
        return false;
    };
    let own = text.lines().take_while(|line| !line.starts_with("==="));
    let code = |line: &'_ str| {
        let words = line.split('#').next().unwrap_or_default();
        words.split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let mut members = own.map(code).filter(|line| !line.is_empty()).peekable();
    if members.peek().is_none() {
        return true;
    }
    let expected = [
        "string[] name",
        "float64[] position",
        "float64[] velocity",
        "float64[] effort",
    ];
    let header = members.next().is_some_and(|m| {
        let kind = m.strip_suffix(" header");
        matches!(
            kind,
            Some("std_msgs/Header" | "std_msgs/msg/Header" | "Header")
        )
    });
    header && members.eq(expected)
}

/// `sensor_msgs/JointState`. Each array has one number per name, or none.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct JointState {
    /// Nanoseconds.
    pub stamp: i64,
    pub name: Vec<String>,
    pub position: Vec<f64>,
    pub velocity: Vec<f64>,
    pub effort: Vec<f64>,
}

impl JointState {
    pub fn decode(bytes: &[u8], version: Version) -> Result<Self, String> {
        let mut from = match version {
            Version::One => Reader::packed(bytes),
            Version::Two => Reader::cdr(bytes)?,
        };
        let seconds = match version {
            Version::One => {
                from.u32()?; // seq
                i64::from(from.u32()?)
            }
            Version::Two => i64::from(from.i32()?),
        };
        let nanoseconds = i64::from(from.u32()?);
        if nanoseconds >= SECOND {
            return Err(format!("a stamp has {nanoseconds} ns beside its seconds"));
        }
        from.text()?; // frame_id
        Ok(Self {
            stamp: seconds * SECOND + nanoseconds,
            name: from.texts()?,
            position: from.numbers()?,
            velocity: from.numbers()?,
            effort: from.numbers()?,
        })
    }
}

/// `sensor_msgs/msg/JointState` in CDR. Each array has one number per name, or none.
pub(crate) fn joint_state(
    stamp: i64,
    names: &[String],
    position: &[f64],
    velocity: &[f64],
    effort: &[f64],
) -> Vec<u8> {
    let mut to = Writer::new();
    header(&mut to, stamp, "");
    to.texts(names);
    to.numbers(position);
    to.numbers(velocity);
    to.numbers(effort);
    to.done()
}

/// `sensor_msgs/msg/PointCloud2` in CDR, with `float32` fields: `x y z stiffness`, `sd` if the field has it, and `rgb`, the
/// colors of `values` as bits `0x00RRGGBB`. `None` for a cloud beyond 4 GiB.
pub(crate) fn point_cloud(
    stamp: i64,
    frame: &str,
    field: &StiffnessField,
    values: &[f64],
    scale: Scale,
) -> Option<Vec<u8>> {
    const FLOAT32: u8 = 7;
    let sd = field.sd.as_deref();
    let names = ["x", "y", "z", "stiffness"].into_iter();
    let names: Vec<_> = names.chain(sd.map(|_| "sd")).chain(["rgb"]).collect();
    let step = 4 * names.len() as u32;
    let width = u32::try_from(field.points.len()).ok()?;
    let row = width.checked_mul(step)?;

    let mut data = Vec::with_capacity(row as usize);
    for (i, (p, &stiffness)) in field.points.iter().zip(&field.stiffness).enumerate() {
        let [r, g, b] = scale.color(values[i]);
        let numbers = [p.x, p.y, p.z, stiffness];
        let numbers = numbers.into_iter().chain(sd.map(|sd| sd[i]));
        data.extend(numbers.flat_map(|v| (v as f32).to_le_bytes()));
        data.extend([b, g, r, 0]);
    }

    let mut to = Writer::new();
    header(&mut to, stamp, frame);
    to.u32(1);
    to.u32(width);
    to.u32(names.len() as u32);
    for (offset, name) in (0..).step_by(4).zip(names) {
        to.text(name);
        to.u32(offset);
        to.byte(FLOAT32);
        to.u32(1);
    }
    to.byte(0); // is_bigendian
    to.u32(step);
    to.u32(row);
    to.bytes(&data);
    to.byte(1); // is_dense
    Some(to.done())
}

/// `tf2_msgs/msg/TFMessage` in CDR: the pose of one frame in another.
pub(crate) fn transform(stamp: i64, frame: &str, child: &str, pose: &Isometry3<f64>) -> Vec<u8> {
    let mut to = Writer::new();
    to.u32(1);
    header(&mut to, stamp, frame);
    to.text(child);
    // Both x, y, z; the rotation then w.
    let rotation = pose.rotation.coords;
    let numbers = pose.translation.vector.iter().chain(&rotation);
    numbers.for_each(|v| to.f64(*v));
    to.done()
}

/// Writes a header; the stamp is from 0 to [`LAST`].
fn header(to: &mut Writer, stamp: i64, frame: &str) {
    to.i32((stamp / SECOND) as i32);
    to.u32((stamp % SECOND) as u32);
    to.text(frame);
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Quaternion, Translation3, UnitQuaternion};

    fn state() -> JointState {
        JointState {
            stamp: 1_500_000_000,
            name: ["a", "bcdef"].map(str::to_owned).to_vec(),
            position: vec![1.0, -2.0],
            velocity: vec![],
            effort: vec![0.5, 0.25],
        }
    }

    /// Bytes worked out by hand: every number at a multiple of its size behind the first four bytes.
    #[test]
    fn val_joint_state_in_cdr() {
        let expected = [
            &[0, 1, 0, 0][..],
            &[1, 0, 0, 0, 0x00, 0x65, 0xcd, 0x1d], // 1 s, 500000000 ns
            &[1, 0, 0, 0, 0, 0, 0, 0],             // frame_id: "" and padding
            &[2, 0, 0, 0],
            &[2, 0, 0, 0, b'a', 0, 0, 0], // with padding
            &[6, 0, 0, 0, b'b', b'c', b'd', b'e', b'f', 0, 0, 0],
            &[2, 0, 0, 0, 0, 0, 0, 0], // position, with padding
            &[0, 0, 0, 0, 0, 0, 0xf0, 0x3f],
            &[0, 0, 0, 0, 0, 0, 0x00, 0xc0],
            &[0, 0, 0, 0], // velocity: nothing, and no padding
            &[2, 0, 0, 0],
            &[0, 0, 0, 0, 0, 0, 0xe0, 0x3f],
            &[0, 0, 0, 0, 0, 0, 0xd0, 0x3f],
        ]
        .concat();
        let s = state();
        let bytes = joint_state(s.stamp, &s.name, &s.position, &s.velocity, &s.effort);
        assert_eq!(bytes, expected);
        assert_eq!(JointState::decode(&bytes, Version::Two).unwrap(), s);
        for length in 0..bytes.len() {
            assert!(JointState::decode(&bytes[..length], Version::Two).is_err());
        }
    }

    #[test]
    fn val_joint_state_in_big_endian_cdr() {
        let bytes = [
            &[0, 0, 0, 0][..],
            &[0, 0, 0, 1, 0x1d, 0xcd, 0x65, 0x00],
            &[0, 0, 0, 1, 0, 0, 0, 0],
            &[0, 0, 0, 2],
            &[0, 0, 0, 2, b'a', 0, 0, 0],
            &[0, 0, 0, 6, b'b', b'c', b'd', b'e', b'f', 0, 0, 0],
            &[0, 0, 0, 2, 0, 0, 0, 0],
            &[0x3f, 0xf0, 0, 0, 0, 0, 0, 0],
            &[0xc0, 0x00, 0, 0, 0, 0, 0, 0],
            &[0, 0, 0, 0],
            &[0, 0, 0, 2],
            &[0x3f, 0xe0, 0, 0, 0, 0, 0, 0],
            &[0x3f, 0xd0, 0, 0, 0, 0, 0, 0],
        ]
        .concat();
        assert_eq!(JointState::decode(&bytes, Version::Two).unwrap(), state());
    }

    /// ROS 1: a counter in front of the stamp, no padding, no zeros behind texts.
    #[test]
    fn val_joint_state_of_ros_1() {
        let bytes = [
            &[9, 0, 0, 0][..],
            &[1, 0, 0, 0, 0x00, 0x65, 0xcd, 0x1d],
            &[0, 0, 0, 0],
            &[2, 0, 0, 0],
            &[1, 0, 0, 0, b'a'],
            &[5, 0, 0, 0, b'b', b'c', b'd', b'e', b'f'],
            &[2, 0, 0, 0],
            &[0, 0, 0, 0, 0, 0, 0xf0, 0x3f],
            &[0, 0, 0, 0, 0, 0, 0x00, 0xc0],
            &[0, 0, 0, 0],
            &[2, 0, 0, 0],
            &[0, 0, 0, 0, 0, 0, 0xe0, 0x3f],
            &[0, 0, 0, 0, 0, 0, 0xd0, 0x3f],
        ]
        .concat();
        assert_eq!(JointState::decode(&bytes, Version::One).unwrap(), state());
    }

    #[test]
    fn val_point_cloud_in_cdr() {
        let field = StiffnessField {
            points: vec![Point3::new(1.0, 2.0, -0.5)],
            stiffness: vec![3.0],
            ..StiffnessField::default()
        };
        let scale = Scale::new(&field.stiffness, None).unwrap();
        let bytes = point_cloud(SECOND, "w", &field, &field.stiffness, scale).unwrap();
        let member = |name: [u8; 4], offset: u8| {
            [
                &[2, 0, 0, 0][..],
                &name,
                &[offset, 0, 0, 0, 7, 0, 0, 0, 1, 0, 0, 0],
            ]
            .concat()
        };
        let expected = [
            &[0, 1, 0, 0][..],
            &[1, 0, 0, 0, 0, 0, 0, 0],
            &[2, 0, 0, 0, b'w', 0, 0, 0], // frame_id, with padding
            &[1, 0, 0, 0, 1, 0, 0, 0],    // height, width
            &[5, 0, 0, 0],
            &member([b'x', 0, 0, 0], 0),
            &member([b'y', 0, 0, 0], 4),
            &member([b'z', 0, 0, 0], 8),
            &[10, 0, 0, 0],
            b"stiffness\0\0\0",
            &[12, 0, 0, 0, 7, 0, 0, 0, 1, 0, 0, 0],
            &[4, 0, 0, 0],
            b"rgb\0",
            &[16, 0, 0, 0, 7, 0, 0, 0, 1, 0, 0, 0],
            &[0, 0, 0, 0],                      // is_bigendian, with padding
            &[20, 0, 0, 0, 20, 0, 0, 0],        // point_step, row_step
            &[20, 0, 0, 0],                     // data
            &[0, 0, 0x80, 0x3f, 0, 0, 0, 0x40], // 1, 2
            &[0, 0, 0, 0xbf, 0, 0, 0x40, 0x40], // -0.5, 3
            &[37, 231, 253, 0],                 // the brightest color, blue first
            &[1],                               // is_dense
        ]
        .concat();
        assert_eq!(bytes, expected);
    }

    #[test]
    fn val_transform_in_cdr() {
        // Half a turn about z.
        let turn = UnitQuaternion::new_unchecked(Quaternion::new(0.0, 0.0, 0.0, 1.0));
        let pose = Isometry3::from_parts(Translation3::new(1.0, 0.0, -2.0), turn);
        let one = [0, 0, 0, 0, 0, 0, 0xf0, 0x3f];
        let expected = [
            &[0, 1, 0, 0][..],
            &[1, 0, 0, 0],
            &[1, 0, 0, 0, 0x00, 0x65, 0xcd, 0x1d], // 1 s, 500000000 ns
            &[2, 0, 0, 0, b'w', 0, 0, 0],          // frame_id, with padding
            &[5, 0, 0, 0, b'b', b'a', b's', b'e', 0, 0, 0, 0], // child_frame_id, with padding
            &one,
            &[0; 8],
            &[0, 0, 0, 0, 0, 0, 0, 0xc0],
            &[0; 16],
            &one,
            &[0; 8],
        ]
        .concat();
        assert_eq!(transform(1_500_000_000, "w", "base", &pose), expected);
    }

    #[test]
    fn definitions_are_told_apart() {
        let own = JOINT_STATE.text.as_bytes();
        let ros_1 =
            b"# comment\n\nHeader header\n\nstring[] name # of joints\nfloat64[]  position\n\
                      float64[] velocity\nfloat64[] effort\n====\nMSG: std_msgs/Header\n";
        for known in [own, &ros_1[..], b"", b"# nothing"] {
            assert!(defines_joint_states(known));
        }
        let swapped = JOINT_STATE
            .text
            .replace("float64[] effort", "float32[] effort");
        let longer = JOINT_STATE.text.replacen("====", "int8 more\n====", 1);
        for other in [
            swapped.as_bytes(),
            longer.as_bytes(),
            b"\xff",
            b"Header header",
        ] {
            assert!(!defines_joint_states(other));
        }
    }
}
