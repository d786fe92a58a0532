//! Elements and attributes of a URDF that are not understood. A misspelled one would change the robot without an error.

use crate::tags;

/// Elements of links and joints by their path, with the elements and attributes that they may contain. The content of other
/// elements, such as visuals and extensions of simulators, is not checked. Names with a prefix (`drake:...`) are extensions.
const KNOWN: [(&str, &[&str], &[&str]); 23] = [
    (
        "link",
        &[
            "inertial",
            "visual",
            "collision",
            "contact",
            "sensor",
            "gazebo",
            "verbose",
        ],
        &["name", "type"],
    ),
    ("link/inertial", &["origin", "mass", "inertia"], &[]),
    ("link/inertial/origin", &[], ORIGIN),
    ("link/inertial/mass", &[], &["value"]),
    (
        "link/inertial/inertia",
        &[],
        &["ixx", "ixy", "ixz", "iyy", "iyz", "izz"],
    ),
    (
        "link/collision",
        &[
            "origin",
            "geometry",
            "material",
            "contact_coefficients",
            "verbose",
        ],
        &["name", "group"],
    ),
    ("link/collision/origin", &[], ORIGIN),
    (
        "link/collision/geometry",
        &["box", "cylinder", "sphere", "capsule", "mesh"],
        &["name"],
    ),
    ("link/collision/geometry/box", &[], &["size"]),
    (
        "link/collision/geometry/cylinder",
        &[],
        &["radius", "length"],
    ),
    (
        "link/collision/geometry/capsule",
        &[],
        &["radius", "length"],
    ),
    ("link/collision/geometry/sphere", &[], &["radius"]),
    ("link/collision/geometry/mesh", &[], &["filename", "scale"]),
    (
        "joint",
        &[
            "origin",
            "parent",
            "child",
            "axis",
            "limit",
            "dynamics",
            "mimic",
            "calibration",
            "safety_controller",
            "gazebo",
        ],
        &["name", "type"],
    ),
    ("joint/origin", &[], ORIGIN),
    ("joint/parent", &[], &["link"]),
    ("joint/child", &[], &["link"]),
    ("joint/axis", &[], &["xyz"]),
    (
        "joint/limit",
        &[],
        &[
            "lower",
            "upper",
            "effort",
            "velocity",
            "acceleration",
            "deceleration",
            "jerk",
        ],
    ),
    ("joint/dynamics", &[], &["damping", "friction"]),
    ("joint/mimic", &[], &["joint", "multiplier", "offset"]),
    (
        "joint/calibration",
        &[],
        &["rising", "falling", "reference_position"],
    ),
    (
        "joint/safety_controller",
        &[],
        &[
            "soft_lower_limit",
            "soft_upper_limit",
            "k_position",
            "k_velocity",
        ],
    ),
];

const ORIGIN: &[&str] = &["xyz", "rpy", "quat_xyzw"];

/// Most findings that are reported. Each line number is counted from the beginning of the text, and in a text that is no
/// robot everything would be a finding.
const MOST: usize = 100;

/// The first elements and attributes of links and joints that are not understood, each with its line, of a text that is
/// balanced.
///
/// Paths are compared name by name: a text may nest many elements in one with a long name.
pub(crate) fn unread(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut open: Vec<&str> = Vec::new();
    for tag in tags::tags(text) {
        if found.len() >= MOST {
            break;
        }
        if tag.starts_with("</") {
            open.pop();
            continue;
        }
        if !tags::begins_element(tag) {
            continue;
        }
        let name = tags::name(tag);
        let above = open.get(1..).unwrap_or_default();
        let is_above = |path: &str| path.split('/').eq(above.iter().copied());
        let is_here = |path: &str| path.split('/').eq(above.iter().copied().chain([name]));
        let at = || tags::line(text, tags::place(text, tag));
        if let Some((_, elements, _)) = KNOWN.iter().find(|(path, ..)| is_above(path))
            && is_strange(name, elements)
        {
            found.push(format!(
                "<{name}> in <{}> (line {})",
                open[open.len() - 1],
                at()
            ));
        }
        if let Some((_, _, attributes)) = KNOWN.iter().find(|(path, ..)| is_here(path)) {
            let strange = tags::attributes(tag).filter(|a| is_strange(a, attributes));
            let strange = strange.take(MOST);
            found.extend(strange.map(|a| format!("{a} of <{name}> (line {})", at())));
        }
        if tags::opens(tag) {
            open.push(name);
        }
    }
    found
}

fn is_strange(name: &str, known: &[&str]) -> bool {
    !known.contains(&name) && !name.contains(':') && name != "xmlns"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misspelled_words_are_found() {
        let text = "<robot name='r'><gazebo><link><orign/></link></gazebo>\n<link name='a'>\n\
            <Inertial/><collision><origin RPY='1 0 0'/>\n<geometry><bax size='1 1 1'/></geometry></collision>\n\
            <visual><geometry><bax/></geometry></visual></link>\n<joint name='j' tipe='fixed' drake:x='1'>\n\
            <orign xyz='0 0 1'/><drake:y/><axis xyz = \"0 0 1\" /></joint>\n<transmission><joint x='1'><y/></joint>\
            </transmission><joints/></robot>";
        let expected = [
            "<Inertial> in <link> (line 3)",
            "RPY of <origin> (line 3)",
            "<bax> in <geometry> (line 4)",
            "tipe of <joint> (line 6)",
            "<orign> in <joint> (line 7)",
        ];
        assert_eq!(unread(text), expected);
        assert!(unread("").is_empty() && unread("<robot/>").is_empty());
        let many = format!("<r><link name='a'>{}</link></r>", "<b/>".repeat(1_000_000));
        assert_eq!(unread(&many).len(), MOST);
        let long = "n".repeat(1 << 20);
        let nested = format!(
            "<r><link name='a'/><{long}>{}</{long}></r>",
            "<b/>".repeat(250_000)
        );
        assert!(unread(&nested).is_empty());
    }
}
