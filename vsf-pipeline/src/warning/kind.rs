use super::{clock, velocities};
use std::f64::consts::TAU;
use std::fmt;
use thiserror::Error;
use vsf_data::TorqueKind;

/// Outlying values of one joint.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Outliers {
    /// Name of the joint.
    pub joint: String,
    /// Number of outliers.
    pub count: usize,
    /// Number of all values.
    pub total: usize,
    /// Sequence of the first outlier.
    pub sequence: String,
    /// Row of the first outlier, from 0.
    pub row: usize,
    /// Value of the first outlier (rad, m, N m or N).
    pub value: f64,
}

impl fmt::Display for Outliers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            joint,
            count,
            total,
            sequence,
            row,
            value,
        } = self;
        write!(
            f,
            "joint {joint}: {count} of {total} samples, the first in sequence {sequence} row {row} \
             with {}",
            short(*value)
        )
    }
}

/// A problem of a recording that does not prevent work with it, but that a person should know.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum PipelineWarning {
    /// A sequence or trace whose parts do not match each other or the robot. Everything that uses it will
    /// refuse it, and the others were not checked.
    #[error("sequence {sequence} cannot be used, and no sequence was checked: {problem}")]
    Malformed {
        /// The sequence.
        sequence: String,
        /// What is wrong.
        problem: String,
    },
    /// A problem of one sequence, not of all.
    #[error("sequence {sequence}: {warning}")]
    InSequence {
        /// The first such sequence.
        sequence: String,
        /// The problem.
        warning: Box<PipelineWarning>,
    },
    /// Angles beyond two turns, or beyond the joint's limits by half a turn: probably in degrees, or,
    /// within a turn, perhaps angles that wrap around.
    #[error("angles must be in radians, these look {like}: {0}", like = alike(.0.value))]
    Degrees(Outliers),
    /// Positions outside the joint's limits, by more than 1e-3 (rad or m).
    #[error("outside the robot's limits {lower:?} .. {upper:?} {unit}: {outliers}")]
    OutsideLimits {
        /// Lower limit.
        lower: f64,
        /// Upper limit.
        upper: f64,
        /// `rad` or `m`.
        unit: &'static str,
        /// Where.
        outliers: Outliers,
    },
    /// Positions that change, within a touch, at more than three times the joint's velocity limit.
    #[error(
        "joint {joint} goes from {from} to {to} {unit} in one sample, sequence {sequence} row {row}, more than three \
         times as fast as the robot's limit of {limit:?} {unit}/s{}; check units, time stamps, missing samples and \
         angles that wrap around",
        more(*others, "joint"),
        from = short(*from), to = short(*to)
    )]
    Jumps {
        /// Name of the first such joint.
        joint: String,
        /// Its limit.
        limit: f64,
        /// `rad` or `m`.
        unit: &'static str,
        /// Sequence of its first jump.
        sequence: String,
        /// The row it leads to, from 0.
        row: usize,
        /// Position before.
        from: f64,
        /// Position after.
        to: f64,
        /// Further joints of that kind.
        others: usize,
    },
    /// A velocity of more than three times the joint's limit, where positions do not change as fast.
    #[error(
        "joint {joint} has a velocity of {value} {unit}/s in sequence {sequence} row {row}, more than three times the \
         robot's limit of {limit:?} {unit}/s, though its positions do not change that fast; it looks like a fault of the \
         recording: leave out that row, or all velocities, which are then estimated{}",
        more(*others, "joint"),
        value = short(*value)
    )]
    TooFast {
        /// Name of the first such joint.
        joint: String,
        /// Its limit.
        limit: f64,
        /// `rad` or `m`.
        unit: &'static str,
        /// Sequence of its first such velocity.
        sequence: String,
        /// Its row, from 0.
        row: usize,
        /// The velocity.
        value: f64,
        /// Further joints of that kind.
        others: usize,
    },
    /// Positions that change, from one row of a touch to the next, more than eight times as fast as in any of the ten rows before
    /// and after.
    #[error(
        "joint {joint} goes from {from} to {to} {unit} in one sample, sequence {sequence} row {row}, more than eight times \
         as far as in any sample beside it; check for rows that are missing, exchanged or of another time{}",
        more(*others, "joint"),
        from = short(*from), to = short(*to)
    )]
    Leaps {
        /// Name of the first such joint.
        joint: String,
        /// `rad` or `m`.
        unit: &'static str,
        /// Sequence of its first leap.
        sequence: String,
        /// The row it leads to, from 0.
        row: usize,
        /// Position before.
        from: f64,
        /// Position after.
        to: f64,
        /// Further joints of that kind.
        others: usize,
    },
    /// Positions that stay at one value for a part of a sequence while their velocities go on.
    #[error(
        "joint {joint} stays at {value} {unit} in {count} successive samples of sequence {sequence}, from row {row} on, while \
         its velocities make it move by {way:.3} {unit}; its encoder looks frozen{}", more(*others, "joint"),
        value = short(*value)
    )]
    FrozenPositions {
        /// Name of the first such joint.
        joint: String,
        /// The first such sequence.
        sequence: String,
        /// Its first such row, from 0.
        row: usize,
        /// How many rows.
        count: usize,
        /// The position there.
        value: f64,
        /// How far the joint moves meanwhile by its velocities (rad or m).
        way: f64,
        /// `rad` or `m`.
        unit: &'static str,
        /// Further joints of that kind.
        others: usize,
    },
    /// Time steps within a touch of more than ten times the usual one and more than 0.1 s.
    #[error(
        "sequence {sequence} row {row} comes {seconds:.3} s after the row before, others {usual:.3} s: samples are \
         missing, and what contact did in between is unknown; if a touch ends there, let the next one begin at that row \
         (touch_starts){}",
        more(*others, "sequence")
    )]
    TimeGap {
        /// The first such sequence.
        sequence: String,
        /// The row after its first gap, from 0.
        row: usize,
        /// Length of the gap (s).
        seconds: f64,
        /// Median time between rows (s).
        usual: f64,
        /// Further sequences of that kind.
        others: usize,
    },
    /// A touch that begins with the arm inside of the object, by more than the contact threshold and the
    /// spacing of the points.
    #[error(
        "sequence {sequence} row {row}: link {link:?} is {depth:.3} m inside of the object where a touch begins; check \
         the pose of the base, the frame and unit of the points, and that recordings begin before the touch{}",
        more(*others, "touch")
    )]
    StartsInside {
        /// Sequence of the deepest such touch.
        sequence: String,
        /// First row of that touch, from 0.
        row: usize,
        /// Name of the link.
        link: String,
        /// Displacement of a point out of the link (m).
        depth: f64,
        /// Further touches of that kind.
        others: usize,
    },
    /// Readings of more than ten times the joint's effort limit.
    #[error(
        "more than ten times the robot's limit of {effort:?} {unit}, check the unit of torques: {outliers}"
    )]
    BeyondEffort {
        /// The limit.
        effort: f64,
        /// `N m` or `N`.
        unit: &'static str,
        /// Where.
        outliers: Outliers,
    },
    /// An arm whose rigid-body torques, by its URDF and its angles, are more than ten times a joint's
    /// effort limit.
    #[error(
        "by the URDF the arm itself takes more than ten times its limit of {effort:?} {unit}, check masses, inertias, gravity \
         and the unit of angles: {outliers}"
    )]
    HeavyArm {
        /// The limit.
        effort: f64,
        /// `N m` or `N`.
        unit: &'static str,
        /// Where.
        outliers: Outliers,
    },
    /// Velocities that are over 1.5 times, or below 1/1.5 of, those that positions and time stamps give.
    #[error(
        "velocities of joint {joint} are {} times the change of its positions over time{}; {}",
        times(*factor), more(*others, "joint"), velocities::cause(*factor)
    )]
    Velocities {
        /// Name of the first such joint.
        joint: String,
        /// Median ratio of the velocities to the change of positions over time.
        factor: f64,
        /// Further joints of that kind.
        others: usize,
    },
    /// Positions that stay constant while velocities say that the joint moves.
    #[error(
        "the angles of joint {joint} stand still while its velocities say that it moves; its encoder looks stuck{}",
        more(*others, "joint")
    )]
    StillPositions {
        /// Name of the first such joint.
        joint: String,
        /// Further joints of that kind.
        others: usize,
    },
    /// Readings in contact that are opposite to those of springs, whatever their stiffness.
    #[error(
        "torques in contact are opposite to those of springs (correlation {correlation:.2} with a uniform stiffness): \
         they look like loads of the robot on the object; check their sign"
    )]
    OppositeTorques {
        /// Correlation with the torques of 1 N/m at every point, -1 to 1.
        correlation: f64,
    },
    /// A sequence whose torques in contact, at equal depth of touch, are over 100 times those of the median
    /// sequence, or less than a hundredth of them.
    #[error(
        "sequence {sequence}: torques in contact are {} times those of sequence {than} at similar depth; check their \
         unit{}", times(*factor), more(*others, "sequence")
    )]
    ScaledTorques {
        /// The first such sequence.
        sequence: String,
        /// Ratio of its stiffness level, the single stiffness that explains its readings in contact best,
        /// to that of the median sequence.
        factor: f64,
        /// The median sequence.
        than: String,
        /// Further sequences of that kind.
        others: usize,
    },
    /// Readings that come late: touches give back more work than was put into them, and fit better with
    /// readings from some time later.
    #[error(
        "torques lag behind the touches: with a delay of {}{seconds:.2} s{} removed, springs leave {:.0} % of the squared \
         error that they leave now; check the clocks of joints and torques, or diagnose a latency (a little shorter than this, since \
         the contact threshold lets touches begin before there is a force)",
        if *is_more { "" } else { "some " }, if *is_more { " or more" } else { "" }, 100.0 * left
    )]
    Late {
        /// Delay of the readings (s).
        seconds: f64,
        /// Whether the delay may be longer.
        is_more: bool,
        /// What springs of equal stiffness at all points leave unexplained after the delay is removed, as a share
        /// of what they leave before.
        left: f64,
    },
    /// Torques of a joint whose scale in contact differs from that of the other joints.
    #[error(
        "in contact the torques of {joint} are some {factor:.2} times what springs that explain the other joints ask for \
         (log likelihood higher by {gain:.0}); check the unit, gear ratio and torque constant of that joint"
    )]
    ScaledJoint {
        /// The joint.
        joint: String,
        /// Ratio of its torques to those that the other joints imply, to within a factor of 1.3.
        factor: f64,
        /// Gain in log evidence (nats) if its torques are divided by that factor.
        gain: f64,
    },
    /// Readings of less than 1e-6 N m (or N) that are not all zero.
    #[error(
        "the largest torque that was read is {largest:e} {unit}: no sensor resolves that; check the unit"
    )]
    TinyReadings {
        /// Largest magnitude that was read.
        largest: f64,
        /// `N m`, `N` or both.
        unit: &'static str,
    },
    /// Readings that are, where nothing is touched, the torques of gravity and of the arm's own motion.
    #[error(
        "where nothing is touched the readings, taken as torque_kind {}, leave {size:.2} times the torques of \
         weight and motion of the arm (correlation {correlation:.2}); check whether they are {}, their unit, and gravity \
         in the frame of the robot's base", kind(*given), kind(other(*given))
    )]
    GravityLeft {
        /// Kind of torques according to the recording.
        given: TorqueKind,
        /// What is left, relative to the torque that the arm itself needs.
        size: f64,
        /// Correlation of what is left with those torques.
        correlation: f64,
    },
    /// Actuator readings that leave, where nothing is touched, twice the torques of weight and motion.
    #[error(
        "where nothing is touched the readings leave {size:.2} times the torques of weight and motion of the arm, as \
         if of the arm on its actuators; check their sign, gravity and base_pose"
    )]
    GravityTwice {
        /// What is left, relative to the torque that the arm itself needs.
        size: f64,
    },
    /// A single reading that is far larger than all others of its joint in a sequence.
    #[error(
        "joint {joint} reads {value:.3} {unit} in row {row} of sequence {sequence}, and {beside:.3} {unit} beside it{}; it looks \
         like a fault of the sensor: leave the row out, or estimate with robust noise (--robust of the command)",
        more(*others, "reading")
    )]
    Spike {
        /// Name of the joint.
        joint: String,
        /// ID of the sequence.
        sequence: String,
        /// Row, from 0.
        row: usize,
        /// The reading.
        value: f64,
        /// The median of this reading and those beside it.
        beside: f64,
        /// `N m` or `N`.
        unit: &'static str,
        /// Number of further such readings.
        others: usize,
    },
    /// Actuator readings that, where nothing is touched, contain the weight of another gravity.
    #[error(
        "where nothing is touched gravity of {} m/s² explains the readings far better than {} ({percent:.0} % of the squared \
         difference would be left); check gravity, base_pose, and unit and sign of the torques",
        vector(gravity), vector(given), percent = 100.0 * left
    )]
    OtherGravity {
        /// The gravity that explains them best (m/s²), world frame.
        gravity: [f64; 3],
        /// The gravity of the recording.
        given: [f64; 3],
        /// Share of the squared differences from the model that remains with the best gravity.
        left: f64,
    },
    /// Readings of some joints whose sign contradicts the other joints.
    #[error(
        "springs explain the readings in contact far better with the other sign of {joints} (log likelihood higher by \
         {gain:.0}); check it"
    )]
    OppositeJoints {
        /// Names of the joints.
        joints: String,
        /// Gain in log likelihood if their sign is flipped (nats).
        gain: f64,
    },
    /// Readings whose columns fit the joints better in another order.
    #[error(
        "springs explain the readings in contact far better with their columns {order} (log likelihood higher by {gain:.0}); \
         check which column is which joint's"
    )]
    MixedColumns {
        /// The better order, in words, or several that cannot be distinguished.
        order: String,
        /// Gain in log likelihood by that order (nats).
        gain: f64,
    },
    /// Readings of some actuators that, where nothing is touched, have the opposite sign.
    #[error(
        "where nothing is touched the readings of {joints} are opposite to the weight and motion of the arm (with the other \
         sign {percent:.0} % of the squared difference would be left); check their signs, gravity and base_pose",
        percent = 100.0 * left
    )]
    OppositeActuators {
        /// Names of the joints.
        joints: String,
        /// Share of their squared differences from the model that remains with the other sign.
        left: f64,
    },
    /// Readings of an actuator that, where nothing is touched, are many times its weight and motion, or a
    /// small part of them.
    #[error(
        "where nothing is touched the readings of {joint} are {factor:.3} times what weight and motion of the arm need \
         (correlation {correlation:.2}); check its unit, gear ratio and torque constant{}", more(*others, "joint")
    )]
    ScaledActuators {
        /// Name of the joint where this is clearest.
        joint: String,
        /// Ratio of readings to the torque that is needed.
        factor: f64,
        /// Correlation of readings and needed torque.
        correlation: f64,
        /// Share of the squared differences of such joints from the model that remains after scaling.
        left: f64,
        /// Further joints of that kind.
        others: usize,
    },
    /// Actuator readings whose columns, where nothing is touched, fit the joints better in another order.
    #[error(
        "where nothing is touched weight and motion of the arm explain the readings far better with their columns {order} \
         ({percent:.0} % of their squared difference would be left); check which column is which joint's",
        percent = 100.0 * left
    )]
    MixedActuators {
        /// The better order, in words.
        order: String,
        /// Share of their squared differences from the model that remains with that order.
        left: f64,
    },
    /// Positions or torques, or both, in another order than that of the joints, according to weight and
    /// motion of the arm.
    #[error(
        "where nothing is touched weight and motion of the arm explain the readings far better with the columns of {of} \
         {order} ({percent:.0} % of the squared difference would be left); check which column is which joint's, as in \
         joint states that are sorted by name",
        percent = 100.0 * left
    )]
    MixedJoints {
        /// The quantity whose columns are mixed.
        of: &'static str,
        /// The better order, in words.
        order: String,
        /// Squares left unexplained by that order, relative to those left by the given one.
        left: f64,
    },
    /// Actuator readings that are not those of this arm.
    #[error(
        "where nothing is touched weight and motion of the arm explain only {percent:.0} % of the squared readings of its \
         actuators; check that it is this robot, its masses, the zero of its joints, base_pose and gravity, and whether \
         the torques are external",
        percent = 100.0 * explained
    )]
    UnexplainedArm {
        /// Share of the squared readings that is explained, 0 to 1.
        explained: f64,
    },
    /// Sequences that touch no point, though their readings look like those of touches.
    #[error(
        "sequence {sequence} touches no point, but its readings change by {change:.3} {unit}, where those of touches \
         change by {touch:.3}{}: the points may not cover what was touched, base_pose may be wrong, or weight or friction \
         of the arm is in the readings",
        more(*others, "sequence")
    )]
    NothingTouched {
        /// ID of the first such sequence.
        sequence: String,
        /// Further sequences of that kind.
        others: usize,
        /// How far its readings get from their median, all joints together (N m or N).
        change: f64,
        /// The same distance for sequences that touch: its median over them.
        touch: f64,
        /// `N m`, `N` or both.
        unit: &'static str,
    },
    /// Parts of touches that are felt where no points are.
    #[error(
        "{:.0} % of what touches add to the squared readings is in samples that touch no point, {:.0} % in sequence \
         {sequence}: the points may not cover what was touched, base_pose or the zeros of joints may be wrong, readings \
         may be late or belong to other samples, or weight or friction of the arm is in them",
        100.0 * share, 100.0 * of_sequence
    )]
    FeltOutside {
        /// Share of such samples in the energy of the readings, beyond noise and about their median in the
        /// air.
        share: f64,
        /// ID of the sequence with the largest part of it.
        sequence: String,
        /// The share in that sequence.
        of_sequence: f64,
    },
    /// Readings that are far from zero where nothing is touched.
    #[error(
        "where nothing is touched the readings average {offset:.3} {unit} (largest at joint {joint}, {mean:.3}), beside \
         {touch:.3} {unit} (rms) that touch adds, and a field takes this offset for stiffness. An offset of the sensor is \
         removed by first samples that are free and at rest (tare_samples); whether it is a payload, a tilt or friction, \
         a diagnosis tells"
    )]
    NotTared {
        /// Name of the joint with the largest mean.
        joint: String,
        /// That mean.
        mean: f64,
        /// Norm of the means of all joints.
        offset: f64,
        /// Root mean square of the readings in contact minus these means, over all joints.
        touch: f64,
        /// `N m`, `N` or both.
        unit: &'static str,
    },
    /// Readings that persist where nothing is touched and change their sign, as those of friction do.
    #[error(
        "where nothing is touched the readings are {size:.3} {unit} (rms, largest at joint {joint}), in contact {touch:.3}: \
         friction of the joints, drift or a payload is in them, and an estimate takes it for stiffness; a diagnosis tells \
         which it is, and corrects it"
    )]
    FeltInAir {
        /// Name of the joint where these readings are largest.
        joint: String,
        /// Root mean square of the means over 16 consecutive samples, over all joints.
        size: f64,
        /// Root mean square of the readings in contact, over all joints.
        touch: f64,
        /// `N m`, `N` or both.
        unit: &'static str,
    },
    /// Samples that come a second or more apart, while nothing moves at the speed of a touch.
    #[error(
        "sequence {sequence}: samples come {step:.3} s apart, and no joint moves faster than {fastest:.1e} rad/s (or m/s) \
         on average; time stamps must be in seconds; unless the arm is that slow, these are {}{}", clock::unit(*step), more(*others, "sequence")
    )]
    SlowClock {
        /// The first such sequence.
        sequence: String,
        /// Median time between rows (s).
        step: f64,
        /// Largest mean speed of a joint, averaged along its way (rad/s or m/s).
        fastest: f64,
        /// Further sequences of that kind.
        others: usize,
    },
    /// Joints that move at more than three times their velocity limit all the way of a sequence.
    #[error(
        "sequence {sequence}: joint {joint} moves at {speed:.3e} {unit}/s on average, its limit is {limit:?}; time stamps \
         must be in seconds, and these are too close together{}", more(*others, "sequence")
    )]
    FastClock {
        /// The first such sequence.
        sequence: String,
        /// The first such joint there.
        joint: String,
        /// Mean speed of that joint (rad/s or m/s).
        speed: f64,
        /// Its velocity limit.
        limit: f64,
        /// `rad` or `m`.
        unit: &'static str,
        /// Further sequences of that kind.
        others: usize,
    },
    /// Samples in which all joints read exactly zero, between samples with large readings.
    #[error(
        "sequence {sequence} row {row}: all joints read exactly 0 between rows in which they do not, as if readings were \
         lost{}; an estimate takes them for free air: leave these samples out", more(*others, "sample")
    )]
    LostReadings {
        /// ID of the first such sequence.
        sequence: String,
        /// Its first such row.
        row: usize,
        /// Further samples of that kind, in all sequences.
        others: usize,
    },
    /// Samples that repeat the one before to the last digit while the arm moves.
    #[error(
        "sequence {sequence}: {count} of {rows} samples repeat the one before exactly, positions and readings, as when a \
         log is written faster than its source delivers{}; each counts as new evidence, which makes standard deviations \
         too small: keep one of each",
        more(*others, "sequence")
    )]
    RepeatedSamples {
        /// ID of the first such sequence.
        sequence: String,
        /// Number of its repeated samples.
        count: usize,
        /// Number of its samples.
        rows: usize,
        /// Further sequences of that kind.
        others: usize,
    },
    /// A joint whose readings stay at one value during part of a sequence, not at the end of their range,
    /// while touch should change them.
    #[error(
        "joint {joint} reads {value} {unit} in {count} successive samples of sequence {sequence}, from row {row} on, \
         while the touch changes; its sensor looks frozen{}", more(*others, "joint"),
        value = short(*value)
    )]
    FrozenReadings {
        /// Name of the first such joint.
        joint: String,
        /// The first such sequence.
        sequence: String,
        /// Its first such row, from 0.
        row: usize,
        /// Number of such rows.
        count: usize,
        /// The value that it reads.
        value: f64,
        /// `N m` or `N`.
        unit: &'static str,
        /// Further joints of that kind.
        others: usize,
    },
    /// A joint that reads the same nonzero value in a whole sequence, while touch should change it and
    /// other joints do change.
    #[error(
        "joint {joint} reads {value} {unit} in all of sequence {sequence} while the touch changes; its sensor \
         looks stuck{}", more(*others, "sequence"),
        value = short(*value)
    )]
    StuckReadings {
        /// Name of the joint.
        joint: String,
        /// The first such sequence.
        sequence: String,
        /// The value that it reads.
        value: f64,
        /// `N m` or `N`.
        unit: &'static str,
        /// Further sequences of that kind.
        others: usize,
    },
    /// A joint that reads zero in all sequences, while touch should change it and other joints do change.
    #[error(
        "joint {joint} reads 0 in all samples while the touch changes, as if it were not measured; the field is fitted to \
         these zeros all the same: give the joint a large noise sd"
    )]
    ZeroReadings {
        /// Name of the joint.
        joint: String,
    },
    /// An actuator that reads one value for a while, although the torque needed to hold and move the arm
    /// changes.
    #[error(
        "joint {joint} reads {value} {unit} in {count} rows of sequence {sequence} from row {row} on, while what the arm \
         alone asks of it changes by {change:.3} {unit}; its sensor looks dead or frozen{}{}",
        again_told(*again),
        more(*others, "joint"),
        value = short(*value)
    )]
    StillActuator {
        /// Name of the joint.
        joint: String,
        /// The first such sequence.
        sequence: String,
        /// Its first such row, from 0.
        row: usize,
        /// Number of such rows.
        count: usize,
        /// The value that it reads.
        value: f64,
        /// Change of the arm's rigid-body torque meanwhile.
        change: f64,
        /// `N m` or `N`.
        unit: &'static str,
        /// How many more times it does so.
        again: usize,
        /// Further joints of that kind.
        others: usize,
    },
    /// A joint whose readings stay within noise of the end of their range while the touch changes
    /// ([`saturated_joints`](crate::saturated_joints)).
    #[error(
        "joint {joint}: {count} readings stay within noise of {level:?} {unit}, the end of their range, while the touch changes, \
         the first in sequence {sequence} row {row}; its sensor looks saturated: what is stiff there comes out too soft"
    )]
    SaturatedReadings {
        /// Name of the joint.
        joint: String,
        /// Number of such readings.
        count: usize,
        /// The level, relative to the tare.
        level: f64,
        /// `N m` or `N`.
        unit: &'static str,
        /// Sequence of the first one.
        sequence: String,
        /// Its row, from 0.
        row: usize,
    },
    /// A joint whose readings stay at their largest or smallest value, sample after sample, while the touch
    /// changes.
    #[error(
        "joint {joint}: {count} readings stay at {value} {unit} while the touch changes, the first in sequence \
         {sequence} row {row}, and none is beyond; its sensor looks saturated: what is stiff there comes out too soft",
        value = short(*value)
    )]
    ClippedReadings {
        /// Name of the joint.
        joint: String,
        /// Number of such readings.
        count: usize,
        /// The end of its range.
        value: f64,
        /// `N m` or `N`.
        unit: &'static str,
        /// Sequence of the first one.
        sequence: String,
        /// Its row, from 0.
        row: usize,
    },
    /// Rest points in pairs or clusters. The spacing that contact uses may then be the one within a
    /// cluster.
    #[error(
        "the rest points come in clusters: the eighth nearest point is {times:.0} times as far away as the nearest, as \
         where several scans of one object are merged; the points of a cluster share the stiffness of their place, and \
         the contact threshold follows the spacing within clusters, {spacing:.2e} m: keep one point of each cluster"
    )]
    ClusteredPoints {
        /// Median distance to the nearest point at another place (m).
        spacing: f64,
        /// Ratio of the distance of the eighth nearest point to that of the nearest.
        times: f64,
    },
    /// Words of a URDF that are not understood. If they are misspelled, a pose, a shape or a mass is
    /// missing.
    #[error(
        "robot {robot:?}: its URDF has {first}, which is not understood and ignored; if that is a misspelled element, the \
         robot lacks it{}", more(*others, "place")
    )]
    UnreadUrdf {
        /// Name of the robot.
        robot: String,
        /// The first such word, and its line.
        first: String,
        /// Number of further such words.
        others: usize,
    },
    /// Links without inertia, of an arm whose rigid-body torques are removed from the readings.
    #[error(
        "links without mass count as weightless, and torque_kind measured needs their weight: {links}; give \
         them mass and inertia in the URDF"
    )]
    Weightless {
        /// Their names.
        links: String,
    },
    /// Links with a physically impossible inertia, of an arm whose rigid-body torques are removed from the
    /// readings.
    #[error(
        "links with an <inertia> that no body can have (one principal moment exceeds the sum of the other two): {links}; \
         torque_kind measured needs them in fast motion, check the URDF"
    )]
    ImpossibleInertia {
        /// Their names.
        links: String,
    },
    /// An online estimator whose innovations are far larger than expected: more than 30 times in mean
    /// square.
    #[error(
        "the squared errors of one-step predictions are {} times what prior and noise allow; do not trust \
         predictions of this field: give a larger noise sd or a smaller prior sd, or let both be chosen",
        whole(*ratio)
    )]
    Overconfident {
        /// [`vsf_core::FilterHealth::nis_ratio`].
        ratio: f64,
    },
    /// A field that misses the readings it was learned from by more than 30 times their noise, in squares.
    #[error(
        "the squared errors of the fit are {} times what the noise allows; do not trust the deviations of this field: \
         give a larger noise sd or a larger prior sd, or let both be chosen",
        whole(*ratio)
    )]
    Misfit {
        /// Mean squared error of a reading in contact, in variances of its noise.
        ratio: f64,
    },
    /// A field that explains next to nothing of the readings it was learned from, or misses them by more
    /// than zero stiffness does.
    #[error(
        "the field explains {} of the squared readings that it has learned from: they are not those of springs at \
         these contacts (sign, unit, order or tare of readings, geometry), or the prior sd that was given is too small or the \
         noise sd too large", percent(*share)
    )]
    ExplainsNothing {
        /// Explained share of the squared readings in contact.
        share: f64,
    },
    /// Sequences of which a field explains next to nothing, though it was learned from them and explains
    /// others. Only sequences with at least a tenth of the mean squared readings per sequence are
    /// considered.
    #[error(
        "the field explains {} of the squared readings of sequence {sequence}, from which it has learned, and more of \
         others: the torques may belong to another sequence or clock than the angles, the object may have moved, or the \
         readings hold what no stiffness explains (an offset, a payload, friction){}",
        percent(*share), more(*others, "sequence")
    )]
    ExplainsNothingOf {
        /// The first such sequence.
        sequence: String,
        /// Explained share of its squared readings in contact.
        share: f64,
        /// Further sequences of that kind.
        others: usize,
    },
    /// Tare samples in contact.
    #[error(
        "sequence {sequence}: {count} of its {tare_samples} tare samples are in contact, the first in row {row}; what \
         they feel is subtracted from the whole sequence{}", more(*others, "sequence")
    )]
    TareInContact {
        /// The first such sequence.
        sequence: String,
        /// Number of its tare samples in contact.
        count: usize,
        /// Number of all of its tare samples.
        tare_samples: usize,
        /// Row of the first one in contact, from 0.
        row: usize,
        /// Further sequences of that kind.
        others: usize,
    },
    /// Tare samples during which readings change by more than a quarter of what the same sequence reads in
    /// contact.
    #[error(
        "sequence {sequence}: readings of its tare samples spread by {spread:.3} {unit} (sd), against \
         {touch:.3} {unit} (rms) in contact; they should be at rest and free{}", more(*others, "sequence")
    )]
    TareSpread {
        /// The first such sequence.
        sequence: String,
        /// Standard deviation of its tare samples, over all joints.
        spread: f64,
        /// Root mean square of its readings in contact, over all joints.
        touch: f64,
        /// `N m`, `N` or both.
        unit: &'static str,
        /// Further sequences of that kind.
        others: usize,
    },
    /// A camera that sees a surface where there are hardly any rest points: less than 1 % of them lie
    /// within one spacing of it.
    #[error(
        "camera/: {near} of {points} rest points lie within {reach:.3} m of the surface that is seen; check \
         depth_scale, world_from_camera and the images"
    )]
    SurfaceElsewhere {
        /// Number of rest points near the surface.
        near: usize,
        /// Number of rest points.
        points: usize,
        /// Distance that counts as near (m): the spacing of the rest points.
        reach: f64,
    },
    /// Intrinsics that no camera has: pixels far from square, or a principal point outside of the image.
    #[error(
        "camera/: fx {:?} and fy {:?}, cx {:?} and cy {:?} are not those of a camera with {} x {} square pixels; check camera.json \
         against the size of the images",
        focal[0], focal[1], center[0], center[1], size[0], size[1]
    )]
    OddCamera {
        /// Focal lengths in x and y (pixels).
        focal: [f64; 2],
        /// Principal point in x and y (pixels).
        center: [f64; 2],
        /// Width and height of the image (pixels).
        size: [usize; 2],
    },
    /// A link larger than 10 m.
    #[error(
        "link {link:?} is {} m across; lengths are in meters, check its shapes and, for a mesh in millimeters, \
         its scale (scale=\"0.001 0.001 0.001\" in the URDF)", whole(*size)
    )]
    HugeLink {
        /// Name of the link.
        link: String,
        /// Longest edge of its bounding box (m).
        size: f64,
    },
    /// A link smaller than 1 mm.
    #[error(
        "link {link:?} is {size:e} m across; lengths are in meters, check its shapes and, for a mesh, that its scale is not \
         applied twice"
    )]
    TinyLink {
        /// Name of the link.
        link: String,
        /// Longest edge of its bounding box (m).
        size: f64,
    },
    /// An object larger than 10 m.
    #[error(
        "the points are {size:.1} m across; lengths are in meters, and points in the frame of the world"
    )]
    HugeObject {
        /// Diagonal of the points' bounding box (m).
        size: f64,
    },
    /// A contact threshold larger than a quarter of the object and than four spacings of its points.
    #[error(
        "contact threshold and padding reach {} m beyond the robot's surface, and the object is {size:.3} m across: much of \
         it is touched at once, which takes long and tells little; lengths are in meters",
        (level * 1e6).round() / 1e6
    )]
    TouchesFromAfar {
        /// Contact threshold plus padding (m).
        level: f64,
        /// Diagonal of the rest points' bounding box (m).
        size: f64,
    },
    /// A mesh with flipped faces: more than 0.5 % of the points near it lie behind such faces, and contact
    /// takes them to be outside of the link.
    #[error(
        "{mesh}: faces are turned inside out, {:.1} % of the points near the mesh lie behind them and are \
         taken to be outside of the link; turn the normals outward in a mesh editor", 100.0 * share
    )]
    TurnedFaces {
        /// File of the mesh, or name of its link.
        mesh: String,
        /// Share of such points among those within 1 cm of the mesh.
        share: f64,
    },
    /// A mesh with openings so wide, or faces so inconsistent, that more than a quarter of the points near
    /// it may be inside or outside.
    #[error(
        "{mesh}: the mesh is open at {open} of {edges} edges, so that the side of {:.0} % of the points near \
         it is a guess; close the openings in a mesh editor, or give the link a simpler shape",
         100.0 * share
    )]
    OpenMesh {
        /// File of the mesh, or name of its link.
        mesh: String,
        /// Number of edges whose faces do not cancel.
        open: usize,
        /// Number of all edges.
        edges: usize,
        /// Share of such points among those within 1 cm of the mesh.
        share: f64,
    },
}

/// What an angle that no joint can have looks like (rad).
fn alike(angle: f64) -> &'static str {
    if angle.abs() > TAU {
        "like degrees"
    } else {
        "like degrees or like angles that wrap around"
    }
}

/// A number to six digits.
fn short(number: f64) -> String {
    let rounded: f64 = format!("{number:.5e}").parse().unwrap_or(number);
    format!("{rounded:?}")
}

/// A factor, however large or small.
fn times(factor: f64) -> String {
    if factor == 0.0 || (1e-3..1e6).contains(&factor.abs()) {
        format!("{factor:.3}")
    } else {
        format!("{factor:.1e}")
    }
}

/// A share, however far below zero.
fn percent(share: f64) -> String {
    if share > -10.0 {
        // What is rounded to zero has no sign.
        format!("{:.1} %", (1e3 * share).round() / 10.0 + 0.0)
    } else {
        format!("{share:.1e} times")
    }
}

/// A number of which decimals say nothing.
fn whole(factor: f64) -> String {
    if factor < 1e6 {
        format!("{factor:.0}")
    } else {
        format!("{factor:.1e}")
    }
}

fn more(others: usize, what: &str) -> String {
    match others {
        0 => String::new(),
        1 => format!("; so it is in 1 more {what}"),
        n if what.ends_with('h') => format!("; so it is in {n} more {what}es"),
        n => format!("; so it is in {n} more {what}s"),
    }
}

fn again_told(times: usize) -> String {
    match times {
        0 => String::new(),
        1 => "; once more after that".to_owned(),
        n => format!("; {n} times more after that"),
    }
}

fn vector([x, y, z]: &[f64; 3]) -> String {
    format!("({x:.2}, {y:.2}, {z:.2})")
}

fn kind(of: TorqueKind) -> &'static str {
    match of {
        TorqueKind::External => "external",
        TorqueKind::Measured => "measured",
    }
}

fn other(than: TorqueKind) -> TorqueKind {
    match than {
        TorqueKind::External => TorqueKind::Measured,
        TorqueKind::Measured => TorqueKind::External,
    }
}

impl PipelineWarning {
    /// Whether it depends on when contact begins in the scene and what springs explain in it. If the
    /// readings were made with another contact model, such a warning is meaningless.
    pub fn rests_on_contact(&self) -> bool {
        match self {
            Self::InSequence { warning, .. } => warning.rests_on_contact(),
            Self::OppositeTorques { .. }
            | Self::ScaledTorques { .. }
            | Self::OppositeJoints { .. }
            | Self::MixedColumns { .. }
            | Self::ScaledJoint { .. }
            | Self::NothingTouched { .. }
            | Self::NotTared { .. }
            | Self::FeltInAir { .. } => true,
            _ => false,
        }
    }

    /// The same as one of a single sequence.
    pub(super) fn in_sequence(self, id: &str) -> Self {
        Self::InSequence {
            sequence: id.to_owned(),
            warning: Box::new(self),
        }
    }

    pub(super) fn and_others(mut self, count: usize) -> Self {
        if let Self::TareInContact { others, .. } | Self::TareSpread { others, .. } = &mut self {
            *others = count;
        }
        self
    }
}
