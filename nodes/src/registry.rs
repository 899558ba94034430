//! The list of all node types and value types, in the order of their names.

use pegbar_engine::registry::Registry;

use crate::basis::BasisPca;
use crate::camera::{CameraCalibrate, CameraOrthographic, CameraPerspective};
use crate::capture::CaptureContour;
use crate::cel::{CelArt, CelCharacter, CelCharacterPose, CelReference, CelScene};
use crate::comp::{CompMask, CompMerge, CompOver};
use crate::curve::{CorrespondCurves, CurveTrace};
use crate::data::{
    Affine2, Basis, Camera, Correspondences, Curves, Drawing, Field2, Field3, Image, KeyDrawings, KeyImages, KeyShapes, Markers2, Markers3,
    Matte, Mesh, MorphTargets, Pose, Shape, Skeleton, SkinnedMesh, Table, WarpPath, Weights,
};
use crate::drawing::DrawingMerge;
use crate::eval::EvalRms;
use crate::field::{FieldLift, FieldPropagate};
use crate::image::{
    ImageBlur, ImageCheckerboard, ImageCleanPlate, ImageConstant, ImageCrop, ImageFromMatte, ImageGrade, ImageGradient, ImageGrain,
    ImageInvert, ImagePremultiply, ImageResize, ImageSharpen, ImageShuffle, ImageStatistics, ImageTransform, ImageUnpremultiply,
    ImageWarpAffine, ImageWarpMesh,
};
use crate::io::{
    IoReadAmc, IoReadBvh, IoReadDrawings, IoReadGltf, IoReadImage, IoReadImages, IoReadKeyDrawings, IoReadKeyShapes, IoReadMarkers,
    IoReadShapes, IoReadValue, IoSearchBvh, IoWriteBvh, IoWriteDrawings, IoWriteGltf, IoWriteImages, IoWriteMarkers, IoWriteTable,
    IoWriteValue,
};
use crate::keys::{KeysBasis, KeysChoose, KeysDraw, KeysInbetween, KeysPick};
use crate::lift::LiftLinear;
use crate::markers::{MarkersFromPose, MarkersProject, MarkersSmooth};
use crate::matte::{MatteColorClusters, MatteFromImage};
use crate::mesh::{MeshFeatures, MeshSilhouette, MeshSmooth};
use crate::motion::{MotionAnticipate, MotionExaggerate, MotionFollowThrough, MotionKeys, MotionPin, MotionSmooth, MotionWarp};
use crate::plot::{PlotBars, PlotCostMatrix, PlotCurves, PlotPlayhead};
use crate::pose::{MeshPin, PoseAlign2d, PoseDescriptor, PoseFit, PoseJointAngles, PosePin, PoseProcrustes, PoseResample};
use crate::render::{RenderCorrespondences, RenderDrawings, RenderMarkers, RenderShadow, RenderShapes, RenderStrip, RenderToon};
use crate::retarget::{RetargetDrawings, RetargetImage, RetargetJointAngles, RetargetMeshes, RetargetShapes};
use crate::shape::{ShapeFitAffine, ShapeResample, ShapeTrace};
use crate::skin::SkinLinearBlend;
use crate::solve::SolveKeyWeights;
use crate::style::{StyleAssemble, StyleFind};
use crate::time::{RetimeApply, RetimeDtw, TimeFindHolds, TimeHold, TimeOffset, TimePick, TimeResample};
use crate::track::{TrackAffine, TrackEigen};
use crate::warp::WarpLayered;
use crate::weights::WeightsKeys;

/// Every node type and value type that Pegbar comes with.
pub fn registry() -> Registry {
    nodes(types(Registry::new()))
}

#[rustfmt::skip]
fn types(registry: Registry) -> Registry {
    registry
        .value::<Affine2>()
        .value::<Basis>()
        .value::<Camera>()
        .value::<Correspondences>()
        .value::<Curves>()
        .value::<Drawing>()
        .value::<Field2>()
        .value::<Field3>()
        .value::<Image>()
        .value::<KeyDrawings>()
        .value::<KeyImages>()
        .value::<KeyShapes>()
        .value::<Markers2>()
        .value::<Markers3>()
        .value::<Matte>()
        .value::<Mesh>()
        .value::<MorphTargets>()
        .value::<Pose>()
        .value::<Shape>()
        .value::<Skeleton>()
        .value::<SkinnedMesh>()
        .value::<Table>()
        .value::<WarpPath>()
        .value::<Weights>()
}

#[rustfmt::skip]
fn nodes(registry: Registry) -> Registry {
    registry
        .whole::<BasisPca>()
        .whole::<CameraCalibrate>()
        .per_frame::<CameraOrthographic>()
        .per_frame::<CameraPerspective>()
        .whole::<CaptureContour>()
        .per_frame::<CelArt>()
        .per_frame::<CelCharacter>()
        .per_frame::<CelCharacterPose>()
        .per_frame::<CelReference>()
        .per_frame::<CelScene>()
        .per_frame::<CompMask>()
        .per_frame::<CompMerge>()
        .per_frame::<CompOver>()
        .per_frame::<CorrespondCurves>()
        .per_frame::<CurveTrace>()
        .per_frame::<DrawingMerge>()
        .whole::<EvalRms>()
        .per_frame::<FieldLift>()
        .per_frame::<FieldPropagate>()
        .per_frame::<ImageBlur>()
        .per_frame::<ImageCheckerboard>()
        .whole::<ImageCleanPlate>()
        .per_frame::<ImageConstant>()
        .per_frame::<ImageCrop>()
        .per_frame::<ImageFromMatte>()
        .per_frame::<ImageGrade>()
        .per_frame::<ImageGradient>()
        .per_frame::<ImageGrain>()
        .per_frame::<ImageInvert>()
        .per_frame::<ImagePremultiply>()
        .per_frame::<ImageResize>()
        .per_frame::<ImageSharpen>()
        .per_frame::<ImageShuffle>()
        .per_frame::<ImageStatistics>()
        .per_frame::<ImageTransform>()
        .per_frame::<ImageUnpremultiply>()
        .per_frame::<ImageWarpAffine>()
        .recurrent::<ImageWarpMesh>()
        .whole::<IoReadAmc>()
        .whole::<IoReadBvh>()
        .per_frame::<IoReadDrawings>()
        .whole::<IoReadGltf>()
        .per_frame::<IoReadImage>()
        .per_frame::<IoReadImages>()
        .per_frame::<IoReadKeyDrawings>()
        .per_frame::<IoReadKeyShapes>()
        .whole::<IoReadMarkers>()
        .per_frame::<IoReadShapes>()
        .per_frame::<IoReadValue>()
        .whole::<IoSearchBvh>()
        .whole::<IoWriteBvh>()
        .whole::<IoWriteDrawings>()
        .whole::<IoWriteGltf>()
        .per_frame::<IoWriteImages>()
        .whole::<IoWriteMarkers>()
        .whole::<IoWriteTable>()
        .whole::<IoWriteValue>()
        .per_frame::<KeysBasis>()
        .whole::<KeysChoose>()
        .per_frame::<KeysDraw>()
        .per_frame::<KeysInbetween>()
        .whole::<KeysPick>()
        .whole::<LiftLinear>()
        .per_frame::<MarkersFromPose>()
        .per_frame::<MarkersProject>()
        .whole::<MarkersSmooth>()
        .recurrent::<MatteColorClusters>()
        .per_frame::<MatteFromImage>()
        .per_frame::<MeshFeatures>()
        .whole::<MeshPin>()
        .recurrent::<MeshSilhouette>()
        .per_frame::<MeshSmooth>()
        .whole::<MotionAnticipate>()
        .whole::<MotionExaggerate>()
        .whole::<MotionFollowThrough>()
        .per_frame::<MotionKeys>()
        .whole::<MotionPin>()
        .whole::<MotionSmooth>()
        .whole::<MotionWarp>()
        .whole::<PlotBars>()
        .whole::<PlotCostMatrix>()
        .whole::<PlotCurves>()
        .per_frame::<PlotPlayhead>()
        .per_frame::<PoseAlign2d>()
        .per_frame::<PoseDescriptor>()
        .per_frame::<PoseFit>()
        .per_frame::<PoseJointAngles>()
        .whole::<PosePin>()
        .per_frame::<PoseProcrustes>()
        .per_frame::<PoseResample>()
        .per_frame::<RenderCorrespondences>()
        .per_frame::<RenderDrawings>()
        .per_frame::<RenderMarkers>()
        .per_frame::<RenderShadow>()
        .per_frame::<RenderShapes>()
        .whole::<RenderStrip>()
        .per_frame::<RenderToon>()
        .recurrent::<RetargetDrawings>()
        .recurrent::<RetargetImage>()
        .per_frame::<RetargetJointAngles>()
        .per_frame::<RetargetMeshes>()
        .recurrent::<RetargetShapes>()
        .per_frame::<RetimeApply>()
        .whole::<RetimeDtw>()
        .per_frame::<ShapeFitAffine>()
        .recurrent::<ShapeResample>()
        .per_frame::<ShapeTrace>()
        .recurrent::<SkinLinearBlend>()
        .whole::<SolveKeyWeights>()
        .per_frame::<StyleAssemble>()
        .whole::<StyleFind>()
        .whole::<TimeFindHolds>()
        .per_frame::<TimeHold>()
        .per_frame::<TimeOffset>()
        .whole::<TimePick>()
        .per_frame::<TimeResample>()
        .recurrent::<TrackAffine>()
        .recurrent::<TrackEigen>()
        .per_frame::<WarpLayered>()
        .per_frame::<WeightsKeys>()
}
