//! Players with the joints of a person, one and a half metres tall, at rest with their arms straight out: a gymnast, a sneak, a dancer, and a flower.
//!
//! All have the same skeleton, so that a motion captured on one is every other's too; limbs lie along the world's axes, so that they squash and stretch
//! along their own. Joints are called as HumanIK has them; what is called `..._end` never turns: it says where the joint above it ends.

use super::design::{Design, Limb, Region, cone, ellipsoid, linear};
use super::field::Blob;

/// Who plays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Player {
    /// A girl with bunches, in a red top and blue shorts.
    Gymnast,
    /// A thief with a mask and a striped jersey.
    Sneak,
    /// A ballerina in a tutu.
    Dancer,
    /// A flower with leaves for hands and a face that beams.
    Flower,
}

/// Left and right.
const SIDES: [(f64, &str); 2] = [(1.0, "Left"), (-1.0, "Right")];
const INK: u32 = 0x1e_14_12;
const WHITE: u32 = 0xfd_fb_f4;

/// What a player is painted with.
struct Paint {
    skin: u32,
    top: u32,
    legs: u32,
    shoes: u32,
    hair: u32,
    /// How thick limbs and trunk are, times a child's.
    girth: f64,
}

impl Player {
    fn paint(self) -> Paint {
        let (skin, top, legs, shoes, hair, girth) = match self {
            Self::Gymnast => (0xf4_c3_9c, 0xe2_4a_33, 0x2d_4f_9e, 0xfb_f6_ea, 0x6b_3a_1e, 1.0),
            Self::Sneak => (0xee_bf_97, 0xf2_ee_e2, 0x3a_3d_4a, 0x22_20_24, 0x2a_2c_38, 1.08),
            Self::Dancer => (0xf6_cf_b0, 0xf0_8f_b4, 0xfb_e3_e6, 0xe0_6f_9a, 0x4a_2a_20, 0.84),
            Self::Flower => (0xff_cf_3f, 0x5f_b0_43, 0x4f_9c_3a, 0x8a_5a_34, 0xf2_6f_a0, 0.62),
        };
        Paint { skin, top, legs, shoes, hair, girth }
    }
}

impl Design {
    /// A player of the size of a person.
    pub fn player(player: Player) -> Self {
        let paint = player.paint();
        let mut design = Self { coat: linear(paint.skin), cell: 0.021, ..Self::default() };
        let [hips, chest, head] = trunk(&mut design, paint.girth);
        design.regions = clothes(player, &paint);
        face(&mut design, head, player);
        match player {
            Player::Gymnast => gymnast(&mut design, head, paint.hair),
            Player::Sneak => sneak(&mut design),
            Player::Dancer => dancer(&mut design, hips, head, paint.hair),
            Player::Flower => flower(&mut design, head, paint.hair),
        }
        // Joints are in the order in which files of captured motion have them: all below one before its next sibling.
        for (side, name) in SIDES {
            arm(&mut design, chest, side, name, paint.girth, player);
        }
        for (side, name) in SIDES {
            leg(&mut design, hips, side, name, paint.girth);
        }
        design
    }
}

/// Height of the arms.
const ARM: f64 = 1.03;
/// Middle of the skull.
const SKULL: [f64; 3] = [0.0, 1.3, 0.015];

fn trunk(d: &mut Design, girth: f64) -> [usize; 3] {
    let hips = d.add_joint("Hips", None, [0.0, 0.66, 0.0]);
    let spine = d.add_joint("Spine", Some(hips), [0.0, 0.77, 0.0]);
    let chest = d.add_joint("Spine1", Some(spine), [0.0, 0.9, 0.0]);
    let neck = d.add_joint("Neck", Some(chest), [0.0, 1.06, 0.0]);
    let head = d.add_joint("Head", Some(neck), [0.0, 1.13, 0.0]);
    d.add_joint("Head_end", Some(head), [0.0, 1.5, 0.0]);
    let g = |r: f64| r * girth;
    d.add_ellipsoid(hips, [0.0, 0.665, 0.0], [g(0.135), 0.1, g(0.11)], [0.0; 3], 0.0);
    d.add_cone(spine, [0.0, 0.76, 0.0], [0.0, 0.86, 0.0], [g(0.105), g(0.108)], 0.05);
    d.add_ellipsoid(chest, [0.0, 0.96, 0.0], [g(0.135), 0.11, g(0.1)], [0.0; 3], 0.05);
    d.add_cone(neck, [0.0, 1.05, 0.0], [0.0, 1.14, 0.0], [g(0.048), g(0.045)], 0.03);
    d.add_ellipsoid(head, SKULL, [0.18, 0.185, 0.17], [0.0; 3], 0.02);
    [hips, chest, head]
}

fn arm(d: &mut Design, chest: usize, side: f64, name: &str, girth: f64, player: Player) {
    let at = |x: f64, y: f64, z: f64| [side * x, ARM + y, z];
    let collar = d.add_joint(&format!("{name}Shoulder"), Some(chest), at(0.03, 0.0, 0.0));
    let upper = d.add_joint(&format!("{name}Arm"), Some(collar), at(0.13, 0.0, 0.0));
    let fore = d.add_joint(&format!("{name}ForeArm"), Some(upper), at(0.35, 0.0, 0.0));
    let hand = d.add_joint(&format!("{name}Hand"), Some(fore), at(0.56, 0.0, 0.0));
    d.add_joint(&format!("{name}Hand_end"), Some(hand), at(0.66, 0.0, 0.0));
    let g = |r: f64| r * girth;
    d.add_cone(collar, at(0.06, -0.01, 0.0), at(0.13, 0.0, 0.0), [g(0.06), g(0.056)], 0.04);
    d.add_cone(upper, at(0.13, 0.0, 0.0), at(0.35, 0.0, 0.0), [g(0.054), g(0.043)], 0.02);
    d.add_cone(fore, at(0.35, 0.0, 0.0), at(0.55, 0.0, 0.0), [g(0.043), g(0.035)], 0.008);
    if player == Player::Flower {
        // A leaf.
        d.add_ellipsoid(hand, at(0.67, 0.0, 0.0), [0.14, 0.02, 0.07], [0.0; 3], 0.02);
    } else {
        d.add_ellipsoid(hand, at(0.62, 0.0, 0.0), [0.062, 0.032, 0.048], [0.0; 3], 0.015);
        d.add_cone(hand, at(0.66, -0.004, 0.006), at(0.7, -0.01, 0.008), [0.034, 0.026], 0.015);
        d.add_cone(hand, at(0.585, -0.004, 0.035), at(0.615, -0.008, 0.082), [0.023, 0.018], 0.012);
    }
    d.limbs.push(Limb { joints: [upper, fore, hand], pole: [0.0, 0.0, -1.0].into() });
}

fn leg(d: &mut Design, hips: usize, side: f64, name: &str, girth: f64) {
    let at = |x: f64, y: f64, z: f64| [side * x, y, z];
    let thigh = d.add_joint(&format!("{name}UpLeg"), Some(hips), at(0.085, 0.63, 0.0));
    let shin = d.add_joint(&format!("{name}Leg"), Some(thigh), at(0.085, 0.36, 0.0));
    let foot = d.add_joint(&format!("{name}Foot"), Some(shin), at(0.085, 0.085, 0.0));
    let toes = d.add_joint(&format!("{name}ToeBase"), Some(foot), at(0.085, 0.035, 0.11));
    d.add_joint(&format!("{name}ToeBase_end"), Some(toes), at(0.085, 0.035, 0.185));
    let g = |r: f64| r * girth;
    d.add_cone(thigh, at(0.082, 0.62, 0.0), at(0.085, 0.36, 0.0), [g(0.086), g(0.056)], 0.05);
    d.add_cone(shin, at(0.085, 0.36, 0.0), at(0.085, 0.1, -0.005), [g(0.055), g(0.041)], 0.01);
    d.add_cone(foot, at(0.085, 0.05, -0.03), at(0.087, 0.045, 0.1), [0.05, 0.045], 0.025);
    d.add_ellipsoid(toes, at(0.089, 0.044, 0.135), [0.056, 0.044, 0.07], [0.0; 3], 0.03);
    d.limbs.push(Limb { joints: [thigh, shin, foot], pole: [0.05 * side, 0.0, 1.0].into() });
}

fn region(hex: u32, blobs: Vec<Blob>) -> Region {
    Region { colour: linear(hex), blobs }
}

/// Top, trousers and shoes; a gymnast has bare arms and shins.
fn clothes(player: Player, paint: &Paint) -> Vec<Region> {
    let long = matches!(player, Player::Sneak | Player::Dancer);
    let mut top = vec![cone([0.0, 0.83, 0.0], [0.0, 0.98, 0.0], [0.16, 0.155], 0.0)];
    let mut legs = vec![ellipsoid([0.0, 0.66, 0.0], [0.2, 0.115, 0.2], [0.0; 3], 0.0)];
    let mut shoes = Vec::new();
    for (side, _) in SIDES {
        let sleeve = if player == Player::Sneak { 0.54 } else { 0.17 };
        top.push(cone([side * 0.08, ARM, 0.0], [side * sleeve, ARM, 0.0], [0.08, 0.08], 0.0));
        let hem = if long { ([side * 0.088, 0.12, 0.0], 0.07) } else { ([side * 0.1, 0.52, 0.0], 0.11) };
        legs.push(cone([side * 0.09, 0.6, 0.0], hem.0, [0.13, hem.1], 0.0));
        shoes.push(ellipsoid([side * 0.088, 0.03, 0.05], [0.14, 0.085, 0.25], [0.0; 3], 0.0));
    }
    let mut all = vec![region(paint.top, top)];
    if player == Player::Sneak {
        all.push(region(0x2b_2c_36, stripes()));
    }
    all.extend([region(paint.legs, legs), region(paint.shoes, shoes)]);
    all
}

/// Of a jersey.
fn stripes() -> Vec<Blob> {
    let round = [0.79, 0.86, 0.93, 1.0].map(|y| ellipsoid([0.0, y, 0.0], [0.3, 0.018, 0.3], [0.0; 3], 0.0));
    let sleeve = |side: f64| [0.19, 0.27, 0.35, 0.43, 0.51].map(|x| ellipsoid([side * x, ARM, 0.0], [0.017, 0.12, 0.12], [0.0; 3], 0.0));
    round.into_iter().chain(SIDES.into_iter().flat_map(|(side, _)| sleeve(side))).collect()
}

fn eye(d: &mut Design, head: usize, side: f64, player: Player) {
    let (x, y, z) = (side * 0.067, 1.315, 0.162);
    let part = |hex, centre: [f64; 3], radii: [f64; 3]| region(hex, vec![ellipsoid(centre, radii, [0.0; 3], 0.0)]);
    let mut parts = vec![
        part(INK, [x - side * 0.008, y - 0.004, z + 0.03], [0.021, 0.03, 0.03]),
        part(WHITE, [x - side * 0.008 + 0.009, y + 0.01, z + 0.032], [0.0085, 0.0095, 0.03]),
    ];
    let lid = match player {
        Player::Sneak => Some((0x25_26_2e, y + 0.022, 0.3)),
        Player::Dancer => Some((0xd8_98_a8, y + 0.03, -0.1)),
        Player::Gymnast | Player::Flower => None,
    };
    if let Some((hex, y, slant)) = lid {
        let lid = [x - side * slant, y + 1.0 - slant * slant / 2.0, z];
        parts.push(part(hex, lid, [1.0; 3]));
    }
    d.add_ball(head, WHITE, [x, y, z - 0.012], [0.042, 0.054, 0.03], [0.0, 20.0 * side, 0.0], parts);
    let brow = [[0.035, 1.388, 0.16], [0.07, 1.402, 0.15], [0.108, 1.388, 0.13]].map(|[x, y, z]| {
        // A sneak's brows come down to the nose.
        [side * x, if player == Player::Sneak { y - 0.5 * (0.1 - x) } else { y }, z]
    });
    d.add_tube(head, INK, &brow, &[0.005, 0.009, 0.004], true);
}

/// Eyes, nose, mouth and cheeks.
fn face(d: &mut Design, head: usize, player: Player) {
    for (side, _) in SIDES {
        eye(d, head, side, player);
    }
    let nose = match player {
        Player::Sneak => (0xe0_92_70, [0.034, 0.03, 0.045]),
        Player::Flower => (0xf0_a0_2a, [0.02, 0.016, 0.016]),
        Player::Gymnast | Player::Dancer => (0xe8_a5_80, [0.02, 0.017, 0.02]),
    };
    d.add_ball(head, nose.0, [0.0, 1.262, 0.186], nose.1, [0.0; 3], Vec::new());
    let mouth: [[f64; 3]; 5] = match player {
        // One corner goes up.
        Player::Sneak => [[-0.05, 1.2, 0.17], [-0.02, 1.197, 0.18], [0.015, 1.199, 0.18], [0.05, 1.212, 0.17], [0.075, 1.234, 0.15]],
        Player::Dancer => [[-0.036, 1.213, 0.17], [-0.018, 1.201, 0.18], [0.0, 1.198, 0.18], [0.018, 1.201, 0.18], [0.036, 1.213, 0.17]],
        Player::Gymnast | Player::Flower => {
            [[-0.078, 1.236, 0.16], [-0.046, 1.2, 0.17], [0.0, 1.186, 0.18], [0.046, 1.2, 0.17], [0.078, 1.236, 0.16]]
        }
    };
    d.add_tube(head, INK, &mouth, &[0.004, 0.0065, 0.0075, 0.0065, 0.004], true);
    let blush = region(0xee_8f_78, SIDES.map(|(s, _)| ellipsoid([s * 0.118, 1.235, 0.14], [0.026, 0.02, 0.05], [0.0; 3], 0.0)).to_vec());
    if player != Player::Sneak {
        d.regions.push(blush);
    }
}

/// A cap of hair down to the brow and the neck.
fn hair(d: &mut Design, hex: u32) {
    d.regions.push(region(
        hex,
        vec![ellipsoid([0.0, 1.39, -0.1], [0.25, 0.2, 0.2], [0.0; 3], 0.0), ellipsoid([0.0, 1.48, 0.05], [0.2, 0.07, 0.16], [0.0; 3], 0.0)],
    ));
}

/// Bunches that fly.
fn gymnast(d: &mut Design, head: usize, hex: u32) {
    hair(d, hex);
    for (side, name) in SIDES {
        let at = |x: f64, y: f64, z: f64| [side * x, y, z];
        let bunch = d.add_joint(&format!("{name}Bunch"), Some(head), at(0.165, 1.38, -0.05));
        let end = d.add_joint(&format!("{name}Tuft"), Some(bunch), at(0.235, 1.36, -0.06));
        d.add_joint(&format!("{name}Tuft_end"), Some(end), at(0.285, 1.24, -0.06));
        d.add_ball(head, 0xf2_d0_4a, at(0.175, 1.38, -0.05), [0.03, 0.03, 0.03], [0.0; 3], Vec::new());
        d.add_cone(bunch, at(0.18, 1.38, -0.05), at(0.235, 1.36, -0.06), [0.03, 0.06], 0.0);
        d.add_cone(end, at(0.235, 1.36, -0.06), at(0.285, 1.24, -0.06), [0.06, 0.018], 0.0);
        d.regions.push(region(hex, vec![cone(at(0.2, 1.385, -0.05), at(0.3, 1.24, -0.06), [0.06, 0.1], 0.0)]));
    }
}

/// A cap and a mask.
fn sneak(d: &mut Design) {
    let dark = 0x2b_2c_36;
    d.regions.push(region(dark, vec![ellipsoid([0.0, 1.5, -0.03], [0.3, 0.12, 0.3], [0.0; 3], 0.0)]));
    d.regions.push(region(dark, vec![ellipsoid([0.0, 1.315, 0.15], [0.3, 0.062, 0.13], [0.0; 3], 0.0)]));
}

/// A tutu and a bun.
fn dancer(d: &mut Design, hips: usize, head: usize, hex: u32) {
    hair(d, hex);
    d.add_ball(head, hex, [0.0, 1.51, -0.06], [0.075, 0.065, 0.075], [0.0; 3], Vec::new());
    d.add_ball(head, 0xe8_6f_a0, [0.0, 1.475, -0.05], [0.085, 0.018, 0.085], [-20.0, 0.0, 0.0], Vec::new());
    d.add_ellipsoid(hips, [0.0, 0.71, 0.0], [0.31, 0.022, 0.31], [0.0; 3], 0.03);
    d.add_ellipsoid(hips, [0.0, 0.685, 0.0], [0.26, 0.02, 0.26], [0.0; 3], 0.02);
    d.regions.push(region(0xfa_b8_d0, vec![ellipsoid([0.0, 0.7, 0.0], [0.5, 0.05, 0.5], [0.0; 3], 0.0)]));
}

/// Petals, and green from the neck down.
fn flower(d: &mut Design, head: usize, hex: u32) {
    d.regions.clear();
    let mut green = vec![cone([0.0, 0.5, 0.0], [0.0, 1.06, 0.0], [0.3, 0.08], 0.0)];
    let mut shoes = Vec::new();
    for (side, _) in SIDES {
        green.push(cone([side * 0.1, ARM, 0.0], [side * 0.9, ARM, 0.0], [0.1, 0.14], 0.0));
        green.push(cone([side * 0.09, 0.6, 0.0], [side * 0.088, 0.05, 0.0], [0.13, 0.12], 0.0));
        shoes.push(ellipsoid([side * 0.088, 0.03, 0.05], [0.14, 0.085, 0.25], [0.0; 3], 0.0));
    }
    let blush = SIDES.map(|(s, _)| ellipsoid([s * 0.118, 1.235, 0.14], [0.026, 0.02, 0.05], [0.0; 3], 0.0)).to_vec();
    d.regions = vec![region(0x5f_b0_43, green), region(0x8a_5a_34, shoes), region(0xf5_9a_3c, blush)];
    for k in 0..10 {
        let angle = f64::from(k) * std::f64::consts::TAU / 10.0;
        let (s, c) = (libm::sin(angle), libm::cos(angle));
        let centre = [SKULL[0] + 0.235 * s, SKULL[1] + 0.235 * c, SKULL[2] - 0.02];
        let shade = if k % 2 == 0 { hex } else { 0xf8_90_b8 };
        d.add_ball(head, shade, centre, [0.075, 0.12, 0.03], [0.0, 0.0, -angle.to_degrees()], Vec::new());
    }
}
