use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::PI;

use nalgebra::{Matrix4, Vector3};

use super::colour::cut;
use super::design::{cone, ellipsoid};
use super::field::{field, gradient, projected};
use super::net::{Net, net, roundness};
use super::solid::{ball, curve, tube};
use super::{Creature, Design, KeyError, Player, turned};
use crate::algo::skeleton::Joint;

fn area(net: &Net) -> f64 {
    net.triangles.iter().map(|t| t.map(|i| net.positions[i as usize])).map(|[a, b, c]| (b - a).cross(&(c - a)).norm() / 2.0).sum()
}

fn volume(positions: &[Vector3<f64>], triangles: &[[u32; 3]]) -> f64 {
    triangles.iter().map(|t| t.map(|i| positions[i as usize])).map(|[a, b, c]| a.dot(&b.cross(&c)) / 6.0).sum()
}

/// The triangles of each connected part, in the order of their first; each edge must have one triangle at either side.
fn parts(triangles: &[[u32; 3]]) -> Vec<Vec<[u32; 3]>> {
    let sides: BTreeSet<[u32; 2]> = triangles.iter().flat_map(|t| (0..3).map(|k| [t[k], t[(k + 1) % 3]])).collect();
    assert_eq!(sides.len(), 3 * triangles.len(), "no edge has two triangles at one side");
    assert!(sides.iter().all(|&[a, b]| sides.contains(&[b, a])), "no edge is open");
    let n = triangles.iter().flatten().max().map_or(0, |m| *m as usize + 1);
    let mut root: Vec<usize> = (0..n).collect();
    fn find(root: &mut [usize], mut i: usize) -> usize {
        while root[i] != i {
            root[i] = root[root[i]];
            i = root[i];
        }
        i
    }
    for t in triangles {
        for k in 0..2 {
            let (a, b) = (find(&mut root, t[k] as usize), find(&mut root, t[k + 1] as usize));
            root[a.max(b)] = a.min(b);
        }
    }
    let mut parts = BTreeMap::new();
    triangles.iter().for_each(|t| parts.entry(find(&mut root, t[0] as usize)).or_insert_with(Vec::new).push(*t));
    parts.into_values().collect()
}

/// Vertices − edges + triangles: 2 for a ball, 0 for a ring.
fn euler(triangles: &[[u32; 3]]) -> i64 {
    let vertices: BTreeSet<u32> = triangles.iter().flatten().copied().collect();
    vertices.len() as i64 - 3 * triangles.len() as i64 / 2 + triangles.len() as i64
}

/// Vertices that are at one place made one.
fn welded(creature: &Creature) -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
    let mut seen = BTreeMap::new();
    let mut positions = Vec::new();
    let number = |p: &[f64; 3]| {
        *seen.entry(p.map(f64::to_bits)).or_insert_with(|| {
            positions.push(Vector3::from(*p));
            positions.len() as u32 - 1
        })
    };
    let numbers: Vec<u32> = creature.positions.iter().map(number).collect();
    (positions, creature.triangles.iter().map(|t| t.map(|i| numbers[i as usize])).collect())
}

fn posed(design: &Design, creature: &Creature, joints: &[Joint]) -> Vec<Vector3<f64>> {
    let motions: Vec<Matrix4<f64>> =
        design.world(joints).iter().zip(design.places()).map(|(m, p)| m * Matrix4::new_translation(&-p)).collect();
    let moved = |v: usize| {
        let own = v * Creature::INFLUENCES..(v + 1) * Creature::INFLUENCES;
        let at = Vector3::from(creature.positions[v]).push(1.0);
        own.map(|i| (motions[creature.joints[i] as usize] * at).xyz() * creature.weights[i]).sum()
    };
    (0..creature.positions.len()).map(moved).collect()
}

#[test]
fn a_round_cone_is_the_union_of_its_balls() {
    let blob = cone([0.0; 3], [0.0, 2.0, 0.0], [0.5, 0.2], 0.0);
    for p in [[0.9, 1.0, 0.3], [0.2, -1.0, 0.0], [0.1, 3.0, 0.4], [0.0, 0.4, 0.7]] {
        let p = Vector3::from(p);
        let balls = (0..=20_000).map(|i| f64::from(i) / 20_000.0);
        let least = balls.map(|t| (p - Vector3::y() * 2.0 * t).norm() - (0.5 - 0.3 * t)).fold(f64::INFINITY, f64::min);
        assert!((blob.distance(&p) - least).abs() < 1e-7, "{p} {} {least}", blob.distance(&p));
    }
    let swallowed = cone([0.0; 3], [0.1, 0.0, 0.0], [0.5, 0.2], 0.0);
    assert!((swallowed.distance(&Vector3::x()) - 0.5).abs() < 1e-12);
}

#[test]
fn an_ellipsoid_has_its_half_axes_where_it_is_turned() {
    let blob = ellipsoid([1.0, 0.0, 0.0], [0.3, 0.2, 0.1], [0.0, 0.0, 90.0], 0.0);
    for p in [[1.0, 0.3, 0.0], [1.2, 0.0, 0.0], [1.0, 0.0, -0.1]] {
        assert!(blob.distance(&p.into()).abs() < 1e-12, "{p:?}");
    }
    assert!((blob.distance(&Vector3::x()) + 0.1).abs() < 1e-12, "its middle is as deep as it is thin");
}

#[test]
fn what_is_far_is_left_out_without_a_trace() {
    let blobs = [cone([0.0; 3], [0.0, 1.0, 0.0], [0.2, 0.2], 0.0), cone([0.3, 0.5, 0.0], [1.0, 0.5, 0.0], [0.1, 0.1], 0.2)];
    let whole = |p: &Vector3<f64>| {
        let [a, b] = blobs.map(|blob| blob.distance(p));
        let h = (0.2 - (a - b).abs()).max(0.0);
        a.min(b) - h * h / 0.8
    };
    for i in 0..1000 {
        let p = Vector3::new(f64::from(i % 10) * 0.2 - 0.5, f64::from(i / 10 % 10) * 0.2 - 0.5, f64::from(i / 100) * 0.2 - 1.0);
        assert!((field(&blobs, &p) - whole(&p)).abs() < 1e-12);
    }
}

#[test]
fn a_ball_is_made_as_round_as_its_edges_are_short() {
    let blobs = [ellipsoid([0.1, 0.2, 0.3], [1.0; 3], [0.0; 3], 0.0)];
    let wrong = |cell: f64| {
        let net = net(&blobs, cell).unwrap();
        assert_eq!((parts(&net.triangles).len(), euler(&net.triangles)), (1, 2));
        assert!(net.positions.iter().all(|p| field(&blobs, p).abs() < 1e-8), "vertices lie on the surface");
        ((1.0 - area(&net) / (4.0 * PI)).abs(), 1.0 - volume(&net.positions, &net.triangles) / (4.0 / 3.0 * PI))
    };
    let (coarse, fine) = (wrong(0.2), wrong(0.1));
    assert!(fine.0 < coarse.0 / 3.0 && fine.1 < coarse.1 / 3.0, "second order: {coarse:?} {fine:?}");
    assert!(fine.1 > 0.0 && fine.1 < 0.005, "it faces out");
}

#[test]
fn a_ring_has_a_hole() {
    let around = |i: i32| [libm::cos(f64::from(i) * PI / 4.0), 0.0, libm::sin(f64::from(i) * PI / 4.0)];
    let blobs: Vec<_> = (0..8).map(|i| cone(around(i), around(i + 1), [0.25, 0.25], 0.05)).collect();
    let ring = net(&blobs, 0.11).unwrap();
    assert_eq!((parts(&ring.triangles).len(), euler(&ring.triangles)), (1, 0));
}

#[test]
fn balls_that_meet_at_a_corner_of_the_grid_stay_closed() {
    let blobs: Vec<_> = (0..4)
        .map(|i| ellipsoid([f64::from(i % 2) * 0.7, f64::from(i / 2) * 0.7, f64::from((i % 2) ^ (i / 2)) * 0.7], [0.5; 3], [0.0; 3], 0.0))
        .collect();
    for cell in [0.13, 0.17, 0.23, 0.31] {
        let net = net(&blobs, cell).unwrap();
        assert_eq!(parts(&net.triangles).len(), 1);
    }
}

#[test]
fn a_border_is_where_the_region_ends() {
    let blobs = [ellipsoid([0.0; 3], [1.0; 3], [0.0; 3], 0.0)];
    let mut net = net(&blobs, 0.1).unwrap();
    let region = |p: &Vector3<f64>| 0.4 - p.y;
    cut(&mut net, &mut Vec::new(), &region, &|p| projected(&|q| field(&blobs, q), p, 0.1, 1e-10));
    assert_eq!((parts(&net.triangles).len(), euler(&net.triangles)), (1, 2));
    let mut cap = Net { positions: net.positions.clone(), triangles: Vec::new() };
    for t in &net.triangles {
        let heights = t.map(|i| region(&net.positions[i as usize]));
        assert!(heights.iter().all(|h| *h < 1e-3) || heights.iter().all(|h| *h > -1e-3), "no triangle has two colours: {heights:?}");
        if heights.iter().sum::<f64>() < 0.0 {
            cap.triangles.push(*t);
        }
        assert!(roundness(&net.positions, *t) > 0.2, "{}", roundness(&net.positions, *t));
    }
    // A cap of height h has an area of 2 pi r h.
    assert!((area(&cap) / (2.0 * PI * 0.6) - 1.0).abs() < 0.01, "{}", area(&cap));
}

#[test]
fn small_solids_are_closed_and_face_out() {
    let ball = ball(&Vector3::new(1.0, 2.0, 3.0), &Vector3::new(0.3, 0.2, 0.1), &turned([20.0, 30.0, 40.0]), 8);
    let points = curve(&[[0.0, 0.0, 0.0], [0.2, 0.1, 0.0], [0.4, 0.0, 0.1]].map(Vector3::from), 5);
    assert_eq!((points.len(), points[5]), (11, Vector3::new(0.2, 0.1, 0.0)));
    let tube = tube(&points, &[0.02; 11], 6);
    for (net, least) in [(&ball, 0.98 * 4.0 / 3.0 * PI * 0.3 * 0.2 * 0.1), (&tube, 0.8 * PI * 0.02 * 0.02 * 0.43)] {
        assert_eq!((parts(&net.triangles).len(), euler(&net.triangles)), (1, 2));
        let volume = volume(&net.positions, &net.triangles);
        assert!(volume > least && volume < least * 1.3, "{volume} {least}");
    }
}

#[test]
fn the_otter_is_closed_at_any_detail() {
    let design = Design::otter();
    let mut counts = Vec::new();
    for detail in [0.75, 1.0, 1.2] {
        let creature = Creature::new(&design, detail).unwrap();
        let (positions, triangles) = welded(&creature);
        let parts = parts(&triangles);
        assert_eq!(parts.len(), 1 + design.features.len(), "the body and each feature");
        for part in &parts {
            assert_eq!(euler(part), 2);
            assert!(volume(&positions, part) > 0.0, "it faces out");
        }
        let body = parts[0].iter().map(|t| roundness(&positions, *t));
        let worst = body.fold(f64::INFINITY, f64::min);
        assert!(worst > 0.05, "no slivers: {worst} at {detail}");
        counts.push(creature.triangles.len());
    }
    assert!(counts.is_sorted() && (10_000..=17_000).contains(&counts[1]), "{counts:?}");
}

#[test]
fn the_otters_arrays_go_together() {
    let design = Design::otter();
    let creature = Creature::new(&design, 1.0).unwrap();
    assert_eq!(creature, Creature::new(&design, 1.0).unwrap(), "the same bits each time");
    let n = creature.positions.len();
    assert_eq!((creature.normals.len(), creature.colors.len(), creature.weights.len()), (n, n, n * Creature::INFLUENCES));
    for weights in creature.weights.chunks(Creature::INFLUENCES) {
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12 && weights.iter().all(|w| *w >= 0.0), "{weights:?}");
    }
    assert!(creature.joints.iter().all(|&j| (j as usize) < design.joints.len()));
    for t in &creature.triangles {
        let [a, b, c] = t.map(|i| creature.colors[i as usize]);
        assert!(a == b && b == c, "a triangle has one colour");
        let [p, q, r] = t.map(|i| Vector3::from(creature.positions[i as usize]));
        let facing = (q - p).cross(&(r - p));
        let normals = t.map(|i| Vector3::from(creature.normals[i as usize]));
        assert!(normals.iter().sum::<Vector3<f64>>().dot(&facing) > 0.0, "normals face out");
    }
    let colours: BTreeSet<_> = creature.colors.iter().map(|c| c.map(f64::to_bits)).collect();
    assert_eq!(colours.len(), 7, "coat, bib, paws, ears, ink, whites, lids");
}

#[test]
fn weights_change_smoothly_over_the_body() {
    let design = Design::otter();
    let creature = Creature::new(&design, 1.0).unwrap();
    let (positions, triangles) = welded(&creature);
    let body: BTreeSet<_> =
        parts(&triangles)[0].iter().flatten().map(|&i| <[f64; 3]>::from(positions[i as usize]).map(f64::to_bits)).collect();
    let dense = |i: u32| {
        let mut dense = vec![0.0; design.joints.len()];
        let own = i as usize * Creature::INFLUENCES..(i as usize + 1) * Creature::INFLUENCES;
        own.for_each(|k| dense[creature.joints[k] as usize] += creature.weights[k]);
        dense
    };
    for t in creature.triangles.iter().filter(|t| body.contains(&creature.positions[t[0] as usize].map(f64::to_bits))) {
        let [a, b] = [dense(t[0]), dense(t[1])];
        let jump = a.iter().zip(&b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
        assert!(jump < 0.45, "{jump} at {:?}", creature.positions[t[0] as usize]);
    }
}

#[test]
fn the_otter_stands_on_the_ground_and_keeps_its_bulk() {
    let design = Design::otter();
    let creature = Creature::new(&design, 1.0).unwrap();
    let (rest, triangles) = welded(&creature);
    let bulk = volume(&rest, &triangles);
    for key in &design.keys {
        let joints = design.key(&key.name, false).unwrap();
        let positions = posed(&design, &creature, &joints);
        let low = positions.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
        if key.grounded {
            assert!((-0.006..0.006).contains(&low), "{} reaches down to {low}", key.name);
        } else {
            assert!(low > 0.1, "{} is in the air: {low}", key.name);
        }
        let kept = volume(&positions, &creature.triangles) / bulk / key.scale.iter().product::<f64>();
        // Blended joints lose some of it where a knee is folded.
        assert!((0.85..1.1).contains(&kept), "{} keeps {kept} of its volume", key.name);
    }
}

#[test]
fn feet_are_where_they_were_put() {
    let design = Design::otter();
    let joints = design.key("walk_contact", false).unwrap();
    let key = design.keys.iter().find(|k| k.name == "walk_contact").unwrap();
    let world = design.world(&joints);
    let raised = joints[0].translation.y - design.joints[0].at.y - key.shift[1];
    for reach in key.reaches.iter().filter(|r| r.in_world) {
        let at = world[design.joint(&reach.joint).unwrap()];
        let off = at.column(3).xyz() - Vector3::from(reach.at) - Vector3::y() * raised;
        assert!(off.norm() < 0.02, "{}: {off}", reach.joint);
        let turn = at.fixed_view::<3, 3>(0, 0) - turned(reach.turn).matrix();
        assert!(turn.amax() < 1e-9, "the sole is turned as it was told");
    }
    assert!(raised.abs() < 0.03);
}

#[test]
fn a_mirrored_pose_is_its_mirror_image() {
    let design = Design::otter();
    for name in design.key_names() {
        let [own, other] = [false, true].map(|mirror| design.world(&design.key(name, mirror).unwrap()));
        for (i, bone) in design.joints.iter().enumerate() {
            let twin = bone.name.replace(".l", ".x").replace(".r", ".l").replace(".x", ".r");
            let there = other[design.joint(&twin).unwrap()].column(3).xyz();
            let here = own[i].column(3).xyz();
            assert!((there - Vector3::new(-here.x, here.y, here.z)).norm() < 1e-9, "{name}: {}", bone.name);
        }
    }
}

#[test]
fn a_pose_that_is_none_is_told_by_name() {
    let error = Design::otter().key("fly", false).unwrap_err();
    assert!(matches!(&error, KeyError::Unknown { found, .. } if found == "fly"));
    assert!(error.to_string().starts_with("expected a pose that the character has: stand, walk_contact, "), "{error}");
}

#[test]
fn the_gradient_points_out() {
    let blobs = [ellipsoid([0.0; 3], [1.0; 3], [0.0; 3], 0.0)];
    let at = Vector3::new(0.6, 0.0, 0.8);
    assert!((gradient(&|p| field(&blobs, p), &at) - at).norm() < 1e-5);
}

#[test]
fn players_have_one_skeleton_in_the_order_of_a_walk_through_it_and_stand_on_the_ground() {
    let joints = |player| {
        Design::player(player)
            .joints
            .iter()
            .filter(|j| !j.name.contains("Bunch") && !j.name.contains("Tuft"))
            .map(|j| (j.name.clone(), j.at))
            .collect::<Vec<_>>()
    };
    for player in [Player::Gymnast, Player::Sneak, Player::Dancer, Player::Flower] {
        let design = Design::player(player);
        assert_eq!(joints(player), joints(Player::Dancer));
        for (j, bone) in design.joints.iter().enumerate().skip(1) {
            // A joint's parent is the one before it, or above that.
            let mut at = j - 1;
            while Some(at) != bone.parent {
                at = design.joints[at].parent.unwrap();
            }
        }
        let creature = Creature::new(&design, 0.75).unwrap();
        let low = creature.positions.iter().map(|p| p[1]).fold(f64::INFINITY, f64::min);
        let high = creature.positions.iter().map(|p| p[1]).fold(f64::NEG_INFINITY, f64::max);
        assert!((-0.012..0.012).contains(&low) && (1.45..1.72).contains(&high), "{player:?} {low} {high}");
        assert!(creature.colors.iter().flatten().all(|c| c.is_finite()));
        let sums = creature.weights.chunks(Creature::INFLUENCES).map(|w| w.iter().sum::<f64>());
        sums.for_each(|s| assert!((s - 1.0).abs() < 1e-9));
    }
}
