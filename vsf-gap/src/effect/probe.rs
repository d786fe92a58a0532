use super::{Site, slides};

/// An experiment that tells effects apart: effects that respond to it change the readings in a way of their own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Probe {
    /// The deepest point of a touch is held for some seconds.
    Hold,
    /// A touch is unloaded as slowly as it was loaded, over the same path.
    Unload,
    /// A touch is repeated at another speed.
    TouchFaster,
    /// The same place is touched again, as deep as before.
    TouchAgain,
    /// A known place is pushed deeper than before.
    TouchDeeper,
    /// A known place is touched in another posture of the arm.
    TouchInOtherPosture,
    /// A known place is pushed along another axis. This is what remains for an arm that has only prismatic joints.
    TouchAlongOtherAxis,
    /// Every joint moves to and fro in free air, at two speeds.
    MoveInAir,
    /// The arm waits in free air; then the same posture is read again.
    Wait,
    /// A known payload is carried through several postures.
    CarryPayload,
}

/// What an arm can be asked for.
#[derive(Clone, Copy)]
pub(crate) struct Arm {
    pub(crate) joints: usize,
    pub(crate) turns: bool,
    pub(crate) touches: bool,
}

impl Arm {
    pub(crate) fn of(site: &Site) -> Self {
        Self {
            joints: site.joints(),
            turns: (0..site.joints()).any(|j| !slides(site, j)),
            touches: !site.rest.is_empty(),
        }
    }
}

impl Probe {
    /// All of them.
    pub(crate) const ALL: [Self; 10] = [
        Self::Hold,
        Self::Unload,
        Self::TouchFaster,
        Self::TouchAgain,
        Self::TouchDeeper,
        Self::TouchInOtherPosture,
        Self::TouchAlongOtherAxis,
        Self::MoveInAir,
        Self::Wait,
        Self::CarryPayload,
    ];

    /// What to do.
    pub(crate) fn action(self) -> &'static str {
        match self {
            Self::Hold => "hold the deepest point of a touch for 5 s",
            Self::Unload => "unload as slowly as loaded, over the same path",
            Self::TouchFaster => "repeat a touch at twice the speed",
            Self::TouchAgain => "touch the same place again, as deep as before",
            Self::TouchDeeper => "push a known place deeper than before",
            Self::TouchInOtherPosture => "touch a known place in another posture of the arm",
            Self::TouchAlongOtherAxis => "push a known place along another axis",
            Self::MoveInAir => "move every joint to and fro in free air, at two speeds",
            Self::Wait => "wait 30 s in free air and read again in the same posture",
            Self::CarryPayload => "carry a known payload through several postures",
        }
    }

    /// Whether an arm can do it. An arm with a single prismatic joint reaches a place in only one way, and to prismatic
    /// joints a weight is the same in all postures.
    pub(crate) fn is_open_to(self, arm: Arm) -> bool {
        let several = arm.touches && arm.joints > 1;
        match self {
            Self::Hold
            | Self::Unload
            | Self::TouchFaster
            | Self::TouchAgain
            | Self::TouchDeeper => arm.touches,
            Self::TouchInOtherPosture => several && arm.turns,
            Self::TouchAlongOtherAxis => several && !arm.turns,
            Self::MoveInAir | Self::Wait => true,
            Self::CarryPayload => arm.turns,
        }
    }
}
