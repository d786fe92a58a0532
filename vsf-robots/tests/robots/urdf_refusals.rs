//! What a URDF or a vector that is wrong gets: a typed error that names the culprit.

use nalgebra::Vector3;
use proptest::prelude::*;
use vsf_core::{CoreError, Shape};
use vsf_robots::{RobotError, RobotModel, UrdfOptions, cartesian_stage, kinova_gen3};

fn parse(text: &str) -> Result<RobotModel, RobotError> {
    RobotModel::from_urdf_str(text, "/nowhere", &UrdfOptions::default())
}

/// A joint from link `a` to link `b` with more inside.
fn joint(kind: &str, inside: &str) -> String {
    format!(
        r#"<robot name="r"><link name="a"/><link name="b"/>
        <joint name="knee" type="{kind}"><parent link="a"/><child link="b"/>{inside}</joint></robot>"#
    )
}

/// Joints named `parent>child` between links a, b, c, d.
fn graph(joints: &[&str]) -> String {
    let mut text = String::from(r#"<robot name="r">"#);
    for link in ["a", "b", "c", "d"] {
        text += &format!(r#"<link name="{link}"/>"#);
    }
    for j in joints {
        let (parent, child) = j.split_once('>').unwrap();
        text += &format!(
            r#"<joint name="{parent}-{child}" type="fixed">
            <parent link="{parent}"/><child link="{child}"/></joint>"#
        );
    }
    text + "</robot>"
}

fn with_link(inside: &str) -> String {
    format!(r#"<robot name="r"><link name="shin">{inside}</link></robot>"#)
}

fn inertial(mass: &str, ixx: &str, ixy: &str) -> String {
    with_link(&format!(
        r#"<inertial><mass value="{mass}"/>
        <inertia ixx="{ixx}" ixy="{ixy}" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>"#
    ))
}

fn collision(geometry: &str) -> String {
    with_link(&format!(
        "<collision><geometry>{geometry}</geometry></collision>"
    ))
}

/// Before version 1.1 the parser drops them without a word.
#[test]
fn quaternions_of_an_older_version_are_refused() {
    let turned = "<origin xyz=\"0 0 1\" quat_xyzw=\"0.7071067811865476 0 0 0.7071067811865476\"/>";
    let text = joint("revolute", turned);
    for version in ["", "version=\"1.0\"", "version=\"one\""] {
        let text = text.replace("<robot", &format!("<robot {version}"));
        let error = parse(&text).unwrap_err().to_string();
        assert!(error.contains("line 2: quat_xyzw counts from"), "{error}");
    }
    for length in ["0 0 0 0", "5 0 0 0"] {
        let turned = format!("<origin xyz='0 0 1' quat_xyzw='{length}'/>");
        let text = joint("revolute", &turned).replace("<robot", "<robot version='1.1'");
        let error = parse(&text).unwrap_err().to_string();
        assert!(error.contains("must be of length 1"), "{error}");
    }
    for version in ["1.1", "1.2"] {
        let text = text.replace("<robot", &format!("<robot version=\"{version}\""));
        let robot = parse(&text).unwrap();
        let mut posture = robot.posture();
        robot.update_posture(&[0.0], &mut posture).unwrap();
        let y = posture.link_poses()[1].rotation * Vector3::y();
        assert!((y - Vector3::z()).norm() < 1e-9, "{y}");
    }
}

/// The parser tells neither a line nor an element.
#[test]
fn what_cannot_be_read_has_an_element_and_a_line() {
    for (text, says) in [
        (
            joint("revolute", "<axis xyz=\"0 1\"/>"),
            "<joint> of line 2: Wrong vector element count, expected 3 found 2",
        ),
        (
            joint("revolte", ""),
            "<joint> of line 2: unknown variant `revolte`",
        ),
        (
            inertial("heavy", "1", "0"),
            "<link> of line 1: invalid float literal",
        ),
        (
            "<robot name=\"r\">\n<link name=\"a\"/>\n\n<joint type=\"fixed\"/></robot>".to_owned(),
            "<joint> of line 4: missing field",
        ),
    ] {
        let error = parse(&text).unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
    }
    // The parser tells a line.
    let unquoted = "<robot name=\"r\">\n\n<link name=a/></robot>";
    let unquoted = parse(unquoted).unwrap_err().to_string();
    assert!(unquoted.contains("Line: 3"), "{unquoted}");
    // Too many elements to look at each.
    let many = "<link name=\"a\"/>\n".repeat(20_000);
    let many = format!("<robot name=\"r\">{many}<joint type=\"fixed\"/></robot>");
    let many = parse(&many).unwrap_err().to_string();
    assert!(
        many.contains("missing field") && !many.contains("of line"),
        "{many}"
    );
}

#[test]
fn text_that_is_not_urdf() {
    for text in [
        "",
        "hello",
        "<robot",
        "<robot name=\"r\"><link name=\"a\"></robot>",
        "<robot name=\"r\"><link/></robot>",
        "<robot name=\"r\"><link name=\"a\"/><joint name=\"j\" type=\"rubber\"/></robot>",
        "<robot name=\"r\" xmlns:xacro=\"x\"><xacro:arm/><link name=\"a\"/></robot>",
        &joint("revolute", "<axis xyz=\"1 0\"/>"),
        &joint("revolute", "<axis xyz=\"one 0 0\"/>"),
    ] {
        assert!(
            matches!(parse(text), Err(RobotError::Urdf { .. })),
            "{text}: {:?}",
            parse(text)
        );
    }
    let deep = with_link(&("<x>".repeat(1_000_000) + &"</x>".repeat(1_000_000)));
    assert!(parse(&deep).unwrap_err().to_string().contains("nested"));
    let Err(RobotError::NoLinks { .. }) = parse("<mujoco model=\"m\"><body/></mujoco>") else {
        panic!()
    };
}

#[test]
fn missing_file() {
    let result = RobotModel::from_urdf_file("/nowhere/arm.urdf", &UrdfOptions::default());
    let message = result.unwrap_err().to_string();
    assert!(message.contains("/nowhere/arm.urdf"), "{message}");
}

/// The line is that of the text as it is written.
#[test]
fn faults_of_syntax_have_a_line() {
    let text =
        "<robot name=\"r\">\n<link name=\"a\"/>\n<link name=\"b\">\n<inertial>\n</link>\n</robot>";
    let message = parse(text).unwrap_err().to_string();
    let says = "line 5: </link> where <inertial> of line 4 is open";
    assert!(message.contains(says), "{message}");
}

/// Moments of 1, 1 and `ixx`: a rod has 0, a disc 2, nothing has more.
#[test]
fn inertia_that_no_body_has_is_told_by_its_link() {
    for (ixx, impossible) in [("0", false), ("2", false), ("2.001", false), ("2.1", true)] {
        let robot = parse(&inertial("1", ixx, "0")).unwrap();
        let links: Vec<&str> = (robot.links_with_impossible_inertia())
            .map(|link| link.name())
            .collect();
        let expected: &[&str] = if impossible { &["shin"] } else { &[] };
        assert_eq!(links, expected, "{ixx}");
    }
    for robot in [kinova_gen3().unwrap(), cartesian_stage(0.01).unwrap()] {
        assert_eq!(robot.links_with_impossible_inertia().count(), 0);
    }
}

#[test]
fn joints_without_one_coordinate() {
    for kind in ["floating", "planar", "spherical"] {
        let message = parse(&joint(kind, "")).unwrap_err().to_string();
        assert!(
            message.contains("'knee'") && message.contains(kind),
            "{message}"
        );
    }
    let mimic = joint("revolute", r#"<mimic joint="hip" multiplier="2"/>"#);
    let Err(RobotError::Mimic { joint, leader }) = parse(&mimic) else {
        panic!()
    };
    assert_eq!((joint.as_str(), leader.as_str()), ("knee", "hip"));
}

#[test]
fn joints_that_form_no_tree() {
    let error = |joints: &[&str]| parse(&graph(joints)).unwrap_err();
    assert!(parse(&graph(&["a>b", "b>c", "a>d"])).is_ok());
    match error(&["a>b", "a>c"]) {
        RobotError::SeveralRoots { roots } => assert_eq!(roots, ["a", "d"]),
        e => panic!("{e}"),
    }
    match error(&["a>b", "a>c", "b>d", "c>d"]) {
        RobotError::TwoParents {
            link,
            first,
            second,
        } => {
            assert_eq!((&*link, &*first, &*second), ("d", "b-d", "c-d"));
        }
        e => panic!("{e}"),
    }
    match error(&["a>b", "b>c", "c>d", "d>a"]) {
        RobotError::Loop { .. } => {}
        e => panic!("{e}"),
    }
    // d hangs below the loop b, c and is not part of it.
    match error(&["b>c", "c>b", "c>d"]) {
        RobotError::Loop { joint, link } => {
            assert!(["b-c", "c-b"].contains(&&*joint) && ["b", "c"].contains(&&*link));
        }
        e => panic!("{e}"),
    }
    match error(&["a>b", "b>c", "d>d"]) {
        RobotError::Loop { joint, link } => assert_eq!((&*joint, &*link), ("d-d", "d")),
        e => panic!("{e}"),
    }
    match error(&["a>b", "b>c", "c>z"]) {
        RobotError::MissingLink { joint, link } => assert_eq!((&*joint, &*link), ("c-z", "z")),
        e => panic!("{e}"),
    }
    let twice = r#"<robot name="r"><link name="a"/><link name="a"/></robot>"#;
    assert!(matches!(
        parse(twice),
        Err(RobotError::DuplicateName { what: "link", .. })
    ));
}

#[test]
fn more_links_than_any_robot_has() {
    let chain = |links: usize| {
        let mut text = String::from(r#"<robot name="snake"><link name="l0"/>"#);
        for k in 1..links {
            text += &format!(
                r#"<link name="l{k}"/><joint name="j{k}" type="continuous">
                <parent link="l{}"/><child link="l{k}"/></joint>"#,
                k - 1
            );
        }
        text + "</robot>"
    };
    assert_eq!(parse(&chain(1000)).unwrap().joint_count(), 999);
    let error = parse(&chain(1001)).unwrap_err();
    let too_many = CoreError::TooMany {
        what: "links of a robot",
        got: 1001,
        max: 1000,
    };
    assert!(matches!(&error, RobotError::Core(e) if *e == too_many));
    let ball = "<collision><geometry><sphere radius=\"1\"/></geometry></collision>";
    let error = parse(&with_link(&ball.repeat(10_001))).unwrap_err();
    assert!(error.to_string().contains("10001"), "{error}");
    // Long lists are cut, long numbers are short.
    let robot = parse(&chain(100)).unwrap();
    let text = robot.link_index("knee").unwrap_err().to_string();
    assert!(text.contains("l29 and 70 more"), "{text}");
    let text = parse(&inertial("-1e300", "1", "0"))
        .unwrap_err()
        .to_string();
    assert!(text.contains("-1e300 kg"), "{text}");
}

#[test]
fn axes_origins_and_limits() {
    for axis in ["0 0 0", "nan 0 1", "inf 0 0"] {
        let text = joint("revolute", &format!(r#"<axis xyz="{axis}"/>"#));
        let Err(RobotError::Axis { joint: name, .. }) = parse(&text) else {
            panic!("{axis}")
        };
        assert_eq!(name, "knee");
        // A fixed joint has no axis to be wrong.
        assert!(parse(&joint("fixed", r#"<axis xyz="0 0 0"/>"#)).is_ok());
    }
    for origin in [r#"xyz="0 nan 0""#, r#"rpy="0 0 inf""#, r#"xyz="1e300 0 0""#] {
        let text = joint("fixed", &format!("<origin {origin}/>"));
        assert!(
            matches!(parse(&text), Err(RobotError::Pose { .. })),
            "{origin}"
        );
    }
    // Two full turns are odd, more are degrees.
    let turned = |angle: &str| joint("fixed", &format!(r#"<origin rpy="0 {angle} 0"/>"#));
    assert!(parse(&turned("-12.5")).is_ok());
    let text = parse(&turned("-90")).unwrap_err().to_string();
    assert!(text.contains("joint 'knee' is turned by -90 rad"), "{text}");
    for limit in [
        r#"lower="1" upper="-1" velocity="1""#,
        r#"lower="nan" upper="1" velocity="1""#,
        r#"lower="-1" upper="1" effort="-1" velocity="1""#,
        r#"lower="-1" upper="1" velocity="nan""#,
    ] {
        let text = joint("prismatic", &format!("<limit {limit}/>"));
        assert!(
            matches!(parse(&text), Err(RobotError::Limits { .. })),
            "{limit}"
        );
    }
    let unstated = parse(&joint("revolute", r#"<limit effort="0" velocity="2"/>"#)).unwrap();
    let limits = unstated.joints()[0].limits();
    assert_eq!(
        (limits.lower, limits.upper),
        (f64::NEG_INFINITY, f64::INFINITY)
    );
    assert_eq!((limits.effort, limits.velocity), (f64::INFINITY, 2.0));
}

#[test]
fn masses_and_inertias() {
    assert!(parse(&inertial("1", "1", "0.5")).is_ok());
    for mass in ["-1", "nan", "inf", "1e308"] {
        let error = parse(&inertial(mass, "1", "0")).unwrap_err();
        assert!(
            matches!(&error, RobotError::Mass { link, .. } if link == "shin"),
            "{error}"
        );
    }
    for (ixx, ixy) in [
        ("-1", "0"),
        ("1", "1.5"),
        ("nan", "0"),
        ("1", "inf"),
        ("0", "1e-3"),
        ("1e300", "0"),
    ] {
        let error = parse(&inertial("1", ixx, ixy)).unwrap_err();
        assert!(
            matches!(&error, RobotError::Inertia { link, .. } if link == "shin"),
            "{error}"
        );
    }
}

#[test]
fn shapes() {
    for bad in [
        r#"<sphere radius="0"/>"#,
        r#"<sphere radius="nan"/>"#,
        r#"<cylinder radius="-1" length="1"/>"#,
        r#"<cylinder radius="1" length="inf"/>"#,
        r#"<capsule radius="1" length="-1"/>"#,
        r#"<box size="1 1 0"/>"#,
        r#"<box size="1 1 1e-320"/>"#,
        r#"<sphere radius="1e300"/>"#,
        r#"<cylinder radius="1" length="1e300"/>"#,
    ] {
        let error = parse(&collision(bad)).unwrap_err();
        assert!(
            matches!(&error, RobotError::Shape { link, .. } if link == "shin"),
            "{error}"
        );
    }
    let capsule = parse(&collision(r#"<capsule radius="1" length="4"/>"#)).unwrap();
    let expected = Shape::Capsule {
        radius: 1.0,
        half_length: 2.0,
    };
    assert_eq!(capsule.colliders()[0].shape, expected);
}

#[test]
fn joint_orders() {
    let text = r#"<robot name="r"><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
        <joint name="z" type="revolute"><parent link="c"/><child link="d"/></joint>
        <joint name="f" type="fixed"><parent link="a"/><child link="c"/></joint>
        <joint name="x" type="prismatic"><parent link="a"/><child link="b"/></joint></robot>"#;
    let read = |order: Option<&[&str]>| {
        let joint_order = order.map(|o| o.iter().map(|n| (*n).to_owned()).collect());
        let options = UrdfOptions {
            joint_order,
            ..UrdfOptions::default()
        };
        RobotModel::from_urdf_str(text, "", &options)
    };
    let names = |r: &RobotModel| {
        r.joints()
            .iter()
            .map(|j| j.name().to_owned())
            .collect::<Vec<_>>()
    };
    assert_eq!(names(&read(None).unwrap()), ["z", "x"]);
    let swapped = read(Some(&["x", "z"])).unwrap();
    assert_eq!(names(&swapped), ["x", "z"]);
    assert_eq!(
        swapped.links().iter().map(|l| l.name()).collect::<Vec<_>>(),
        ["a", "c", "d", "b"]
    );
    assert_eq!(
        swapped.chains().chain(swapped.link_index("d").unwrap()),
        [1]
    );
    assert_eq!(swapped.joint_index("z").unwrap(), 1);
    // Whatever the order.
    let last = |r: &RobotModel| r.joints()[r.last_joint().unwrap()].name().to_owned();
    assert_eq!(last(&swapped), last(&read(None).unwrap()));

    match read(Some(&["x"])).unwrap_err() {
        RobotError::IncompleteJointOrder { missing } => assert_eq!(missing, ["z"]),
        e => panic!("{e}"),
    }
    match read(Some(&["x", "z", "f"])).unwrap_err() {
        RobotError::UnknownJoint { name, known } => {
            assert_eq!(
                (name.as_str(), known),
                ("f", vec!["z".to_owned(), "x".to_owned()])
            );
        }
        e => panic!("{e}"),
    }
    assert!(matches!(
        read(Some(&["x", "x"])),
        Err(RobotError::DuplicateName { .. })
    ));
}

#[test]
fn vectors_postures_and_workspaces() {
    let robot = kinova_gen3().unwrap();
    let (mut posture, mut workspace) = (robot.posture(), robot.dynamics_workspace());
    let g = Vector3::new(0.0, 0.0, -9.81);
    let mut q = [0.1; 7];
    assert!(matches!(
        robot.update_posture(&q[..6], &mut posture),
        Err(CoreError::Length {
            got: 6,
            expected: 7,
            ..
        })
    ));
    assert!(
        robot
            .gravity_torques(&q, &Vector3::repeat(f64::NAN), &mut workspace)
            .is_err()
    );
    assert!(
        robot
            .inverse_dynamics(&q, &q[..2], &q, &g, &mut workspace)
            .is_err()
    );
    assert!(
        robot
            .inverse_dynamics(&q, &q, &[f64::NAN; 7], &g, &mut workspace)
            .is_err()
    );
    q[2] = f64::INFINITY;
    assert!(matches!(
        robot.update_posture(&q, &mut posture),
        Err(CoreError::NotFinite { index: 2, .. })
    ));
    assert!(robot.mass_matrix(&q, &mut workspace).is_err());

    let stage = cartesian_stage(0.01).unwrap();
    let foreign = stage.update_posture(&[0.0; 3], &mut posture);
    assert!(matches!(foreign, Err(CoreError::ForeignPosture { .. })));
    let foreign = stage.gravity_torques(&[0.0; 3], &g, &mut workspace);
    assert!(matches!(foreign, Err(RobotError::ForeignWorkspace)));
    assert!(
        stage
            .update_posture(&[f64::MAX; 3], &mut stage.posture())
            .is_err()
    );
    assert!(
        robot
            .link_index("hand")
            .unwrap_err()
            .to_string()
            .contains("Bracelet_Link")
    );
    assert!(
        robot
            .joint_index("Fix_world")
            .unwrap_err()
            .to_string()
            .contains("Actuator7")
    );

    let nowhere = nalgebra::Isometry3::translation(f64::NAN, 0.0, 0.0);
    assert!(matches!(
        stage.with_base_pose(nowhere),
        Err(RobotError::Pose { .. })
    ));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever the bytes are, reading ends with a model or an error.
    #[test]
    fn damaged_text_never_panics(at in 0..400usize, length in 0..30usize, with in "\\PC{0,8}") {
        let mut text = joint("revolute", r#"<origin xyz="1 2 3" rpy="0 0 1"/><axis xyz="0 1 0"/>
            <limit lower="-1" upper="1" velocity="2"/>"#);
        let end = (at + length).min(text.len());
        if at < end {
            text.replace_range(at..end, &with);
        }
        let _ = parse(&text);
    }
}

#[test]
fn entities_are_refused() {
    let laughs = r#"<!DOCTYPE robot [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>
        <robot name="&b;"><link name="a"/></robot>"#;
    let error = parse(laughs).unwrap_err().to_string();
    assert!(error.contains("entities"), "{error}");
}

/// A URDF may name any path of the machine that reads it.
#[test]
#[cfg(target_os = "linux")]
fn devices_do_not_fill_the_memory() {
    let error = RobotModel::from_urdf_file("/dev/zero", &UrdfOptions::default()).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("/dev/zero: it is a pipe or a device"),
        "{error}"
    );
    let error = parse(&collision(r#"<mesh filename="/dev/zero"/>"#)).unwrap_err();
    assert!(error.to_string().contains("unknown format"), "{error}");
}

/// The parser panics where it writes such a name again.
#[test]
fn prefixes_that_are_none_are_refused() {
    for text in [
        "<robot name='a' xmlns='u' :b='1'/>",
        "<robot name='a' xmlns='u'><:b/></robot>",
        "<robot name='a' xmlns:xmlns='u'/>",
        // Found by the fuzzer: the parser sees a name where quotes do not match.
        "\u{1c}_<o.\n<<Q=\n'<\0\0\0\0<?'?/\u{1}\0\0?'\n=\n''''''/='\0,\0\0\0@<?<<Q=\n'<\0\0\0\0<?'?/='\0o\0\0?/=\
         'xmlns:xmlns='\0,,,,,,,\0/'?/='\0,,,,,,,\0/i?/='\0,,,,,,,\0/'?/='\0,,,,,,$\0/i'/>",
    ] {
        let error = RobotModel::from_urdf_str(text, ".", &UrdfOptions::default());
        let error = error.unwrap_err().to_string();
        assert!(error.contains("begins with ':'"), "{error}");
    }
}
