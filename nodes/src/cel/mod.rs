//! Drawn footage with known truth, for examples and for measuring trackers, mattes and fits.

mod art;
mod character;
mod character_pose;
mod reference;
mod scene;

pub(crate) use art::CelArt;
pub(crate) use character::CelCharacter;
pub(crate) use character_pose::CelCharacterPose;
pub(crate) use reference::CelReference;
pub(crate) use scene::CelScene;

use std::sync::{Arc, Mutex, PoisonError};

use pegbar_engine::node::NodeError;

use crate::algo::cel::{CelSpec, Scene};
use crate::data::{Image, Matte};

/// Scenes whose ground is painted already: painting it takes longer than drawing a frame, and every frame of a scene has the same.
static PAINTED: Mutex<Vec<Arc<Scene>>> = Mutex::new(Vec::new());
/// More than a graph has at once.
const MOST_PAINTED: usize = 4;

fn scene(spec: CelSpec) -> Result<Arc<Scene>, NodeError> {
    let mut painted = PAINTED.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(scene) = painted.iter().find(|s| *s.spec() == spec) {
        return Ok(scene.clone());
    }
    let scene = Arc::new(Scene::new(spec).map_err(|e| NodeError::input(e.to_string()))?);
    if painted.len() == MOST_PAINTED {
        painted.remove(0);
    }
    painted.push(scene.clone());
    Ok(scene)
}

fn image(spec: &CelSpec, samples: Vec<f32>) -> Result<Image, NodeError> {
    Image::new(spec.width, spec.height, 4, samples).ok_or_else(|| NodeError::internal("a drawing of another size than its frame"))
}

fn matte(spec: &CelSpec, alpha: Vec<f32>) -> Result<Matte, NodeError> {
    Matte::new(spec.width, spec.height, alpha).ok_or_else(|| NodeError::internal("a matte of another size than its frame"))
}
