//! An otter on its hind legs: a long supple body, short legs with webbed feet, a thick tapering tail, a round head with a pale bib and a cheeky look.

use super::design::{Design, Limb, Region, cone, ellipsoid, linear};
use super::field::Blob;
use super::pose::{Key, Reach};

const COAT: u32 = 0x8a_55_33;
const PALE: u32 = 0xf1_d9_b0;
const DARK: u32 = 0x5a_34_22;
const LID: u32 = 0x7a_48_2a;
const INK: u32 = 0x1e_14_12;
const WHITE: u32 = 0xfd_fb_f4;
const PINK: u32 = 0xd9_8a_78;

/// Left and right.
const SIDES: [(f64, &str); 2] = [(1.0, "l"), (-1.0, "r")];

impl Design {
    /// An otter, 1.05 m tall.
    pub fn otter() -> Self {
        let mut design = Self { coat: linear(COAT), cell: 0.019, ..Self::default() };
        let [chest, head] = trunk(&mut design);
        for (side, name) in SIDES {
            leg(&mut design, side, name);
            arm(&mut design, chest, side, name);
            face_half(&mut design, head, side, name);
        }
        face(&mut design, head);
        design.regions = regions();
        design.keys = keys();
        design
    }
}

/// The head is drawn about this point, and made larger by this much: a cartoon's.
const HEAD: ([f64; 3], f64) = ([0.0, 0.83, 0.03], 1.16);

/// A point of the head.
fn on_head([x, y, z]: [f64; 3]) -> [f64; 3] {
    let ([px, py, pz], scale) = HEAD;
    [px + (x - px) * scale, py + (y - py) * scale, pz + (z - pz) * scale]
}

/// Radii on the head.
fn sized<const N: usize>(radii: [f64; N]) -> [f64; N] {
    radii.map(|r| r * HEAD.1)
}

/// An ellipsoid on the head.
fn head_blob(centre: [f64; 3], radii: [f64; 3], turn: [f64; 3], blend: f64) -> Blob {
    ellipsoid(on_head(centre), sized(radii), turn, blend)
}

/// Hips to head, and the tail.
fn trunk(d: &mut Design) -> [usize; 2] {
    let hips = d.add_joint("hips", None, [0.0, 0.33, -0.01]);
    let spine = d.add_joint("spine", Some(hips), [0.0, 0.43, 0.0]);
    let chest = d.add_joint("chest", Some(spine), [0.0, 0.56, 0.0]);
    let neck = d.add_joint("neck", Some(chest), [0.0, 0.69, 0.0]);
    let head = d.add_joint("head", Some(neck), [0.0, 0.78, 0.01]);
    d.add_ellipsoid(hips, [0.0, 0.34, 0.0], [0.14, 0.125, 0.125], [0.0; 3], 0.0);
    d.add_cone(spine, [0.0, 0.43, 0.01], [0.0, 0.54, 0.005], [0.122, 0.104], 0.06);
    d.add_ellipsoid(spine, [0.0, 0.41, 0.05], [0.118, 0.12, 0.1], [0.0; 3], 0.05);
    d.add_cone(chest, [0.0, 0.56, 0.005], [0.0, 0.66, 0.0], [0.103, 0.09], 0.03);
    d.add_cone(neck, [0.0, 0.69, 0.0], [0.0, 0.78, 0.01], [0.086, 0.09], 0.03);
    d.body.push(Blob { joint: head, ..head_blob([0.0, 0.895, 0.02], [0.136, 0.112, 0.12], [0.0; 3], 0.05) });
    let places = [[0.28, -0.06], [0.175, -0.17], [0.11, -0.29], [0.078, -0.42], [0.06, -0.55], [0.046, -0.67], [0.036, -0.78]];
    let radii = [0.108, 0.09, 0.073, 0.057, 0.044, 0.032, 0.02];
    let mut parent = hips;
    for i in 0..6 {
        let [start, end] = [i, i + 1].map(|i| [0.0, places[i][0], places[i][1]]);
        parent = d.add_joint(&format!("tail.{}", i + 1), Some(parent), start);
        d.add_cone(parent, start, end, [radii[i], radii[i + 1]], if i == 0 { 0.08 } else { 0.006 });
    }
    [chest, head]
}

fn leg(d: &mut Design, side: f64, name: &str) {
    let at = |x: f64, y: f64, z: f64| [side * x, y, z];
    let thigh = d.add_joint(&format!("thigh.{name}"), d.joint("hips"), at(0.08, 0.31, 0.0));
    let shin = d.add_joint(&format!("shin.{name}"), Some(thigh), at(0.095, 0.18, 0.035));
    let foot = d.add_joint(&format!("foot.{name}"), Some(shin), at(0.098, 0.065, -0.005));
    let toes = d.add_joint(&format!("toes.{name}"), Some(foot), at(0.103, 0.028, 0.085));
    d.add_cone(thigh, at(0.085, 0.3, 0.0), at(0.095, 0.18, 0.03), [0.084, 0.058], 0.05);
    d.add_cone(shin, at(0.095, 0.18, 0.03), at(0.098, 0.065, -0.005), [0.055, 0.04], 0.012);
    d.add_cone(foot, at(0.098, 0.04, -0.008), at(0.103, 0.03, 0.085), [0.04, 0.03], 0.03);
    for out in [-1.0, 0.0, 1.0_f64] {
        let start = at(0.103 + 0.014 * out, 0.03, 0.08);
        d.add_cone(toes, start, at(0.108 + 0.057 * out, 0.021, 0.2 - 0.018 * out.abs()), [0.027, 0.021], 0.015);
    }
    // The web between the toes.
    d.add_ellipsoid(toes, at(0.106, 0.016, 0.13), [0.066, 0.015, 0.05], [0.0; 3], 0.012);
    d.limbs.push(Limb { joints: [thigh, shin, foot], pole: [0.1 * side, 0.0, 1.0].into() });
}

fn arm(d: &mut Design, chest: usize, side: f64, name: &str) {
    let at = |x: f64, y: f64, z: f64| [side * x, y, z];
    let upper = d.add_joint(&format!("upper_arm.{name}"), Some(chest), at(0.085, 0.645, 0.015));
    let fore = d.add_joint(&format!("forearm.{name}"), Some(upper), at(0.175, 0.565, 0.005));
    let hand = d.add_joint(&format!("hand.{name}"), Some(fore), at(0.255, 0.49, 0.015));
    d.add_cone(upper, at(0.085, 0.64, 0.015), at(0.175, 0.565, 0.005), [0.05, 0.039], 0.04);
    d.add_cone(fore, at(0.175, 0.565, 0.005), at(0.255, 0.49, 0.015), [0.038, 0.032], 0.008);
    d.add_ellipsoid(hand, at(0.28, 0.466, 0.018), [0.042, 0.027, 0.042], [0.0, 0.0, -43.0 * side], 0.02);
    for out in [-1.0, 0.0, 1.0_f64] {
        let start = at(0.288, 0.459, 0.018 + 0.02 * out);
        d.add_cone(hand, start, at(0.333 - 0.006 * out.abs(), 0.416, 0.018 + 0.05 * out), [0.023, 0.0205], 0.016);
    }
    d.add_cone(hand, at(0.268, 0.476, 0.045), at(0.287, 0.485, 0.092), [0.022, 0.019], 0.014);
    d.limbs.push(Limb { joints: [upper, fore, hand], pole: [0.7 * side, 0.0, -1.0].into() });
}

fn face_half(d: &mut Design, head: usize, side: f64, name: &str) {
    let at = |x: f64, y: f64, z: f64| on_head([side * x, y, z]);
    // Cheek and muzzle.
    d.body.push(Blob { joint: head, ..head_blob([side * 0.08, 0.853, 0.05], [0.075, 0.062, 0.07], [0.0; 3], 0.04) });
    d.body.push(Blob { joint: head, ..head_blob([side * 0.036, 0.855, 0.13], [0.055, 0.042, 0.047], [0.0; 3], 0.018) });
    let ear = d.add_joint(&format!("ear.{name}"), Some(head), at(0.115, 0.95, -0.005));
    d.body.push(Blob {
        joint: ear,
        ..head_blob([side * 0.13, 0.957, -0.008], [0.032, 0.031, 0.019], [0.0, 18.0 * side, -30.0 * side], 0.015)
    });
    eye(d, head, side);
    for (i, y) in [0.868, 0.852, 0.836].into_iter().enumerate() {
        let drop = 0.02 - 0.025 * i as f64;
        let points = [at(0.062, y, 0.155), at(0.13, y + 0.008 + drop, 0.165), at(0.2, y - 0.01 + 1.6 * drop, 0.14)];
        d.add_tube(head, INK, &points, &[0.0028, 0.0022, 0.001], false);
    }
}

fn eye(d: &mut Design, head: usize, side: f64) {
    let region =
        |hex, centre: [f64; 3], radii: [f64; 3]| Region { colour: linear(hex), blobs: vec![head_blob(centre, radii, [0.0; 3], 0.0)] };
    let (x, y) = (side * 0.049, 0.935);
    // One lid hangs lower, and slants to the nose, under a brow that is drawn down: it has something in mind.
    let lid = if side > 0.0 { 0.949 } else { 0.966 };
    let slant = if side > 0.0 { 0.22 } else { 0.05 };
    let regions = vec![
        region(INK, [x - side * 0.007, y - 0.003, 0.15], [0.021, 0.029, 0.03]),
        region(WHITE, [x - side * 0.007 + 0.009, y + 0.01, 0.152], [0.0085, 0.0095, 0.03]),
        region(LID, [x - side * slant, lid + 1.0 - slant * slant / 2.0, 0.11], [1.0; 3]),
    ];
    d.add_ball(head, WHITE, on_head([x, y, 0.112]), sized([0.044, 0.052, 0.038]), [0.0, 12.0 * side, 0.0], regions);
    let brow = if side > 0.0 {
        [[0.012, 0.984, 0.13], [0.045, 1.003, 0.125], [0.085, 1.003, 0.1]]
    } else {
        [[-0.018, 1.005, 0.13], [-0.05, 1.022, 0.12], [-0.09, 1.004, 0.1]]
    };
    d.add_tube(head, DARK, &brow.map(on_head), &[0.006, 0.0105, 0.004], true);
}

fn face(d: &mut Design, head: usize) {
    // Chin, nose, smirk.
    d.body.push(Blob { joint: head, ..head_blob([0.0, 0.813, 0.105], [0.05, 0.032, 0.047], [0.0; 3], 0.03) });
    d.add_ball(head, INK, on_head([0.0, 0.889, 0.168]), sized([0.034, 0.022, 0.02]), [-15.0, 0.0, 0.0], Vec::new());
    let smirk =
        [[-0.066, 0.84, 0.15], [-0.035, 0.822, 0.17], [0.0, 0.834, 0.18], [0.036, 0.82, 0.17], [0.075, 0.84, 0.15], [0.1, 0.875, 0.13]];
    d.add_tube(head, INK, &smirk.map(on_head), &[0.003, 0.005, 0.0045, 0.005, 0.0055, 0.003], true);
    d.add_tube(head, INK, &[[0.0, 0.872, 0.19], [0.0, 0.853, 0.18], [0.0, 0.834, 0.18]].map(on_head), &[0.004, 0.004], true);
}

fn regions() -> Vec<Region> {
    let region = |hex, blobs| Region { colour: linear(hex), blobs };
    let bib = vec![
        ellipsoid([0.0, 0.42, 0.14], [0.1, 0.17, 0.1], [0.0; 3], 0.0),
        cone([0.0, 0.55, 0.11], [0.0, 0.7, 0.11], [0.085, 0.08], 0.05),
        head_blob([0.0, 0.83, 0.12], [0.14, 0.058, 0.11], [0.0; 3], 0.06),
    ];
    let mut all = vec![region(PALE, bib)];
    for (side, _) in SIDES {
        let at = |x: f64, y: f64, z: f64| [side * x, y, z];
        all.push(region(DARK, vec![cone(at(0.302, 0.455, 0.03), at(0.36, 0.38, 0.02), [0.08, 0.09], 0.0)]));
        all.push(region(DARK, vec![ellipsoid(at(0.1, 0.0, 0.13), [0.3, 0.075, 0.12], [0.0; 3], 0.0)]));
        all.push(region(PINK, vec![head_blob(at(0.133, 0.957, 0.014), [0.019, 0.018, 0.016], [0.0, 18.0 * side, 0.0], 0.0)]));
    }
    all
}

fn key(name: &str) -> Key {
    Key { name: name.to_owned(), shift: [0.0; 3], turn: [0.0; 3], scale: [1.0; 3], grounded: true, turns: Vec::new(), reaches: Vec::new() }
}

impl Key {
    fn at(self, shift: [f64; 3], turn: [f64; 3]) -> Self {
        Self { shift, turn, ..self }
    }

    fn scaled(self, scale: [f64; 3]) -> Self {
        Self { scale, ..self }
    }

    fn turns(mut self, turns: &[(&str, [f64; 3])]) -> Self {
        self.turns.extend(turns.iter().map(|(joint, turn)| ((*joint).to_owned(), *turn)));
        self
    }

    /// Pitch of each joint of the tail, its root first, and a swing to the side that all share.
    fn tail(mut self, pitch: [f64; 6], swing: f64) -> Self {
        self.turns.extend(pitch.iter().enumerate().map(|(i, x)| (format!("tail.{}", i + 1), [*x, swing, 0.0])));
        self
    }

    fn foot(mut self, side: &str, at: [f64; 3], turn: [f64; 3]) -> Self {
        self.reaches.push(Reach { joint: format!("foot.{side}"), in_world: true, at, turn, pole: None });
        self
    }

    fn hand(mut self, side: &str, at: [f64; 3], turn: [f64; 3]) -> Self {
        self.reaches.push(Reach { joint: format!("hand.{side}"), in_world: false, at, turn, pole: None });
        self
    }
}

fn keys() -> Vec<Key> {
    [stand()].into_iter().chain(walk()).chain(jump()).collect()
}

/// Weight on one leg, arms at ease.
fn stand() -> Key {
    key("stand")
        .at([0.012, -0.012, 0.0], [0.0, 0.0, 3.0])
        .turns(&[("spine", [-3.0, 0.0, -4.0]), ("chest", [4.0, 0.0, -3.0]), ("head", [2.0, 8.0, 5.0])])
        .foot("l", [0.095, 0.06, 0.0], [0.0, 12.0, 0.0])
        .foot("r", [-0.1, 0.06, 0.02], [0.0, -18.0, 0.0])
        .hand("l", [0.15, -0.07, 0.06], [0.0; 3])
        .hand("r", [-0.15, -0.07, 0.06], [0.0; 3])
        .tail([0.0; 6], 6.0)
}

/// Contact with the left heel, down, passing, up.
fn walk() -> [Key; 4] {
    [
        key("walk_contact")
            .at([0.0, -0.03, 0.0], [6.0, -14.0, 0.0])
            .turns(&[("spine", [-2.0, 10.0, 0.0]), ("chest", [-4.0, 16.0, 0.0]), ("neck", [2.0, -6.0, 0.0]), ("head", [-4.0, -6.0, 0.0])])
            .foot("l", [0.085, 0.075, 0.15], [-28.0, 4.0, 0.0])
            .foot("r", [-0.085, 0.105, -0.15], [42.0, -4.0, 0.0])
            .turns(&[("toes.r", [-38.0, 0.0, 0.0])])
            .hand("l", [0.17, -0.06, -0.08], [0.0; 3])
            .hand("r", [-0.12, 0.02, 0.17], [0.0; 3])
            .tail([4.0, -4.0, -2.0, 8.0, 14.0, 16.0], 7.0),
        key("walk_down")
            .at([0.012, -0.075, 0.01], [10.0, -9.0, 3.0])
            .turns(&[("spine", [4.0, 6.0, -3.0]), ("chest", [4.0, 10.0, -2.0]), ("neck", [2.0, -4.0, 0.0]), ("head", [4.0, -4.0, 2.0])])
            .foot("l", [0.085, 0.06, 0.1], [0.0, 6.0, 0.0])
            .foot("r", [-0.085, 0.135, -0.17], [58.0, -4.0, 0.0])
            .turns(&[("toes.r", [-45.0, 0.0, 0.0])])
            .hand("l", [0.17, -0.09, -0.07], [0.0; 3])
            .hand("r", [-0.13, -0.06, 0.16], [0.0; 3])
            .tail([8.0, 0.0, 0.0, 8.0, 14.0, 16.0], 5.0),
        key("walk_passing")
            .at([0.018, 0.002, 0.0], [4.0, 0.0, -3.0])
            .turns(&[("spine", [-2.0, 0.0, 3.0]), ("chest", [0.0, 0.0, 3.0]), ("head", [-2.0, 0.0, -3.0])])
            .foot("l", [0.08, 0.06, 0.0], [0.0, 5.0, 0.0])
            .foot("r", [-0.085, 0.185, -0.03], [30.0, -5.0, 0.0])
            .turns(&[("toes.r", [-30.0, 0.0, 0.0])])
            .hand("l", [0.14, -0.11, 0.03], [0.0; 3])
            .hand("r", [-0.14, -0.11, 0.04], [0.0; 3])
            .tail([4.0, 6.0, 6.0, 4.0, 0.0, -6.0], 0.0),
        key("walk_up")
            .at([0.012, 0.022, 0.02], [1.0, 8.0, -1.0])
            .turns(&[("spine", [-5.0, -6.0, 2.0]), ("chest", [-6.0, -9.0, 2.0]), ("neck", [0.0, 3.0, 0.0]), ("head", [-6.0, 3.0, -1.0])])
            .foot("l", [0.085, 0.075, -0.06], [16.0, 4.0, 0.0])
            .turns(&[("toes.l", [-16.0, 0.0, 0.0])])
            .foot("r", [-0.085, 0.125, 0.13], [-12.0, -5.0, 0.0])
            .hand("l", [0.13, -0.03, 0.13], [0.0; 3])
            .hand("r", [-0.17, -0.07, -0.06], [0.0; 3])
            .tail([12.0, 6.0, 0.0, -8.0, -14.0, -16.0], -5.0),
    ]
}

/// Crouch, launch, stretch in the air, tuck, land, settle.
fn jump() -> [Key; 6] {
    let feet =
        |k: Key, y: f64, z: f64, pitch: f64| k.foot("l", [0.1, y, z], [pitch, 10.0, 0.0]).foot("r", [-0.1, y, z], [pitch, -10.0, 0.0]);
    let hands = |k: Key, at: [f64; 3]| k.hand("l", at, [0.0; 3]).hand("r", [-at[0], at[1], at[2]], [0.0; 3]);
    let crouch = key("jump_crouch")
        .at([0.0, -0.14, -0.05], [30.0, 0.0, 0.0])
        .scaled([1.06, 0.94, 1.06])
        .turns(&[("spine", [16.0, 0.0, 0.0]), ("chest", [8.0, 0.0, 0.0]), ("neck", [-16.0, 0.0, 0.0]), ("head", [-26.0, 0.0, 0.0])])
        .tail([-4.0, -6.0, -2.0, 6.0, 14.0, 18.0], 0.0);
    let launch = key("jump_launch")
        .at([0.0, 0.06, 0.05], [12.0, 0.0, 0.0])
        .scaled([0.95, 1.1, 0.95])
        .turns(&[("spine", [-6.0, 0.0, 0.0]), ("chest", [-10.0, 0.0, 0.0]), ("neck", [-4.0, 0.0, 0.0]), ("head", [-16.0, 0.0, 0.0])])
        .turns(&[("toes.l", [-50.0, 0.0, 0.0]), ("toes.r", [-50.0, 0.0, 0.0])])
        .tail([-12.0, 0.0, 4.0, 2.0, 0.0, 0.0], 0.0);
    let stretch = Key { grounded: false, ..key("jump_stretch") }
        .at([0.0, 0.45, 0.0], [14.0, 0.0, 0.0])
        .scaled([0.92, 1.16, 0.92])
        .turns(&[("spine", [-8.0, 0.0, 0.0]), ("chest", [-10.0, 0.0, 0.0]), ("neck", [-6.0, 0.0, 0.0]), ("head", [-12.0, 0.0, 0.0])])
        .tail([-34.0, -10.0, 2.0, 10.0, 14.0, 16.0], 0.0);
    let tuck = Key { grounded: false, ..key("jump_tuck") }
        .at([0.0, 0.5, 0.0], [-6.0, 0.0, 0.0])
        .scaled([1.04, 0.96, 1.04])
        .turns(&[("spine", [22.0, 0.0, 0.0]), ("chest", [18.0, 0.0, 0.0]), ("neck", [-6.0, 0.0, 0.0]), ("head", [-18.0, 0.0, 0.0])])
        .tail([4.0, 14.0, 22.0, 26.0, 26.0, 24.0], 0.0);
    let land = key("jump_land")
        .at([0.0, -0.17, -0.03], [24.0, 0.0, 0.0])
        .scaled([1.16, 0.82, 1.16])
        .turns(&[("spine", [14.0, 0.0, 0.0]), ("chest", [8.0, 0.0, 0.0]), ("neck", [-2.0, 0.0, 0.0]), ("head", [-16.0, 0.0, 0.0])])
        .tail([2.0, 18.0, 22.0, 8.0, -18.0, -30.0], 0.0);
    let settle = key("jump_settle")
        .at([0.0, -0.02, 0.0], [2.0, 0.0, 0.0])
        .scaled([0.98, 1.03, 0.98])
        .turns(&[("spine", [-4.0, 0.0, 0.0]), ("chest", [-4.0, 0.0, 0.0]), ("head", [-2.0, 0.0, 0.0])])
        .tail([2.0, 2.0, 0.0, -2.0, -4.0, -4.0], 0.0);
    [
        hands(feet(crouch, 0.065, 0.0, 0.0), [0.17, -0.03, -0.12]),
        hands(feet(launch, 0.15, -0.06, 60.0), [0.2, 0.22, 0.06]),
        hands(feet(stretch, 0.47, -0.1, 65.0), [0.17, 0.27, 0.02]),
        hands(feet(tuck, 0.67, 0.1, 22.0), [0.17, -0.02, 0.16]),
        hands(feet(land, 0.065, 0.02, 0.0), [0.22, -0.02, 0.09]),
        hands(feet(settle, 0.065, 0.01, 0.0), [0.18, -0.05, 0.05]),
    ]
}
