//! `cel.character_pose`: a key pose of a character.
//!
//! **Method** see [`crate::algo::creature`]: joints turned as an animator set them; legs and arms bent in a plane so that feet and hands are where they
//! belong; the whole let down until it stands on y = 0, unless it is in the air.
//!
//! **Source** the walk and the jump of Bregler, Loeb, Chuang, Deshpande 2002, figures 14 and 15; keys after Williams, *The Animator's Survival Kit*, 2001.
//!
//! **Fails when** the character has no such pose.
//!
//! **Cost** O(joints).
//!
//! ```ron
//! "contact": (type: "cel.character_pose", character: otter, pose: walk_contact),
//! ```

use pegbar_engine::node::{Context, NodeError, PerFrame};
use pegbar_engine::{Node, Outputs};

use super::character::Character;
use crate::data::Pose;

/// What the character does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, pegbar_engine::Setting)]
pub(crate) enum KeyPose {
    /// Stands at ease, its weight on one leg.
    #[default]
    Stand,
    /// Walks: the left heel meets the ground, the legs farthest apart.
    WalkContact,
    /// Walks: the left foot takes the weight, the body lowest.
    WalkDown,
    /// Walks: the right foot passes the left.
    WalkPassing,
    /// Walks: pushes off the left foot, the body highest.
    WalkUp,
    /// Jumps: wound up to leap.
    JumpCrouch,
    /// Jumps: the toes leave the ground.
    JumpLaunch,
    /// Jumps: stretched, in the air.
    JumpStretch,
    /// Jumps: knees drawn up at the top.
    JumpTuck,
    /// Jumps: squashed on the ground.
    JumpLand,
    /// Jumps: up again, a little too far.
    JumpSettle,
}

impl KeyPose {
    fn name(self) -> &'static str {
        match self {
            Self::Stand => "stand",
            Self::WalkContact => "walk_contact",
            Self::WalkDown => "walk_down",
            Self::WalkPassing => "walk_passing",
            Self::WalkUp => "walk_up",
            Self::JumpCrouch => "jump_crouch",
            Self::JumpLaunch => "jump_launch",
            Self::JumpStretch => "jump_stretch",
            Self::JumpTuck => "jump_tuck",
            Self::JumpLand => "jump_land",
            Self::JumpSettle => "jump_settle",
        }
    }
}

/// A key pose of a character of `cel.character`.
#[derive(Node)]
#[node(
    id = "cel.character_pose",
    version = 2,
    kind = source,
    outputs = CelCharacterPoseOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, figs. 14, 15; Williams 2001",
    example = "\"contact\": (type: \"cel.character_pose\", character: otter, pose: walk_contact)"
)]
pub(crate) struct CelCharacterPose {
    /// Who it is.
    #[input(default = otter)]
    character: Character,
    /// What it does.
    #[input(default = stand)]
    pose: KeyPose,
    /// Left for right: the other step of a walk.
    #[input(default = false)]
    mirror: bool,
}

/// The pose.
#[derive(Outputs)]
pub(crate) struct CelCharacterPoseOutputs {
    /// The pose, for the skeleton of `cel.character`. The walk stays in place.
    pose: Pose,
}

impl PerFrame for CelCharacterPose {
    fn run(self, _cx: &Context) -> Result<CelCharacterPoseOutputs, NodeError> {
        let key = self.character.design().key(self.pose.name(), self.mirror);
        Ok(CelCharacterPoseOutputs { pose: key.map_err(|e| NodeError::input(e.to_string()))?.into_iter().collect() })
    }
}
