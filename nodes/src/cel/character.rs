//! `cel.character`: a character with a skeleton.
//!
//! **Method** see [`crate::algo::creature`]: clay about joints, made into a closed surface, coloured by regions and bound to the joints.
//!
//! **Source** the otter of Bregler, Loeb, Chuang, Deshpande, *Turning to the Masters: Motion Capturing Cartoons*, 2002, figures 9, 14 and 15.
//!
//! **Fails when** the surface cannot be made at that detail.
//!
//! **Cost** O(triangles); the last characters made are kept.
//!
//! ```ron
//! "otter": (type: "cel.character", character: otter),
//! ```

use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::Matrix4;
use pegbar_engine::node::{Context, NodeError, PerFrame};
use pegbar_engine::{Node, Outputs};

use crate::algo::creature::{Creature, Design, Player};
use crate::data::{Mesh, Skeleton, SkinnedMesh};

/// Who is played.
#[derive(Clone, Copy, Debug, PartialEq, Eq, pegbar_engine::Setting)]
pub(crate) enum Character {
    /// An otter on its hind legs, 1.05 metres tall: a long supple body, webbed feet, a thick tail, a cheeky look.
    Otter,
    /// A girl with bunches, in a red top and blue shorts. She and the next three have one skeleton, a person's of 1.5 metres, its arms straight out at rest.
    Gymnast,
    /// A thief with a mask and a striped jersey.
    Sneak,
    /// A ballerina in a tutu.
    Dancer,
    /// A flower with leaves for hands.
    Flower,
}

impl Character {
    pub(super) fn design(self) -> Design {
        match self {
            Self::Otter => Design::otter(),
            Self::Gymnast => Design::player(Player::Gymnast),
            Self::Sneak => Design::player(Player::Sneak),
            Self::Dancer => Design::player(Player::Dancer),
            Self::Flower => Design::player(Player::Flower),
        }
    }
}

/// A character with a skeleton, at rest: on y = 0 about the origin, looking along +z, its left at +x.
#[derive(Node)]
#[node(
    id = "cel.character",
    version = 1,
    kind = source,
    outputs = CelCharacterOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, figs. 9, 14, 15",
    example = "\"otter\": (type: \"cel.character\", character: otter)"
)]
pub(crate) struct CelCharacter {
    /// Who it is.
    #[input(default = otter)]
    character: Character,
    /// Fineness of the surface: edges are as much shorter. 1 has some 15,000 triangles, 2 four times as many.
    #[input(default = 1.0, range = 0.75..=4.0)]
    detail: f64,
}

/// The character.
#[derive(Outputs)]
pub(crate) struct CelCharacterOutputs {
    /// Its surface, with the colour of each vertex; where two colours meet, each has vertices of its own at the same place.
    mesh: SkinnedMesh,
    /// Its joints, whose axes at rest are the world's.
    skeleton: Skeleton,
}

/// Characters made already: a graph has few.
static MADE: Mutex<Vec<(Character, u64, Arc<SkinnedMesh>)>> = Mutex::new(Vec::new());
/// More than a graph has at once.
const MOST_MADE: usize = 4;

impl PerFrame for CelCharacter {
    fn run(self, _cx: &Context) -> Result<CelCharacterOutputs, NodeError> {
        let design = self.character.design();
        let mut made = MADE.lock().unwrap_or_else(PoisonError::into_inner);
        let key = (self.character, self.detail.to_bits());
        let known = made.iter().find(|(character, detail, _)| (*character, *detail) == key).map(|(_, _, mesh)| mesh.clone());
        let mesh = match known {
            Some(mesh) => mesh,
            None => {
                let mesh = Arc::new(mesh(&design, self.detail)?);
                if made.len() == MOST_MADE {
                    made.remove(0);
                }
                made.push((key.0, key.1, mesh.clone()));
                mesh
            }
        };
        Ok(CelCharacterOutputs { mesh: (*mesh).clone(), skeleton: skeleton(&design)? })
    }
}

fn mesh(design: &Design, detail: f64) -> Result<SkinnedMesh, NodeError> {
    let creature = Creature::new(design, detail).ok_or_else(|| {
        NodeError::input(format!("expected a detail at which the surface is closed, found {detail}; try one a little larger"))
    })?;
    let mesh = Mesh {
        positions: creature.positions,
        triangles: Arc::new(creature.triangles),
        normals: creature.normals,
        colors: Arc::new(creature.colors),
        ..Mesh::default()
    };
    let inverse_bind: Vec<_> = design.places().map(|p| Matrix4::new_translation(&-p)).collect();
    SkinnedMesh::new(mesh, Creature::INFLUENCES, creature.joints, creature.weights, &inverse_bind).map_err(NodeError::internal)
}

fn skeleton(design: &Design) -> Result<Skeleton, NodeError> {
    let (parents, rest): (Vec<_>, Vec<_>) = design.skeleton().map(|(_, parent, at)| (parent, Matrix4::new_translation(&at))).unzip();
    let names = design.skeleton().map(|(name, _, _)| name.to_owned()).collect();
    Skeleton::new(parents, &rest, names).map_err(NodeError::internal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mesh_and_skeleton_go_together() {
        let design = Character::Otter.design();
        let (mesh, skeleton) = (mesh(&design, 0.75).unwrap(), skeleton(&design).unwrap());
        assert_eq!(mesh.n_joints(), skeleton.n_joints());
        let world = crate::algo::skeleton::world_from_joint(&skeleton.parents, &skeleton.rest()).unwrap();
        for (world, inverse_bind) in world.iter().zip(mesh.inverse_bind()) {
            assert!((world * inverse_bind - Matrix4::identity()).amax() < 1e-12, "the rest pose leaves the surface where it is");
        }
        assert_eq!(skeleton.names[0], "hips");
    }
}
