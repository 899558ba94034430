//! The drawings themselves, as path data in design units, and a painted orange that passes for a photograph.

use super::drawing::Drawing;
use super::noise::{fbm, noise, smoothstep};
use crate::algo::paint::{Canvas, FillRule, hex};
use kurbo::{Affine, Circle, Point, Shape};

const INK: u32 = 0x1d1a2b;

/// A soft blue felt hat: pinched crown, plum band with a bow, a red feather, a brim that curls up at both ends.
pub(super) fn hat(line_width: f64, seed: u64) -> Drawing {
    let outline = "M-110 26C-96 55 -44 66 4 64C54 62 96 49 112 17C116 7 107 2 98 10C87 20 74 27 60 30C62 4 57 -30 46 -53C40 -67 24 -70 13 -62\
                   C6 -57 1 -53 -4 -51C-11 -59 -23 -71 -37 -65C-52 -58 -60 -18 -62 33C-76 32 -89 25 -97 16C-106 6 -117 14 -110 26Z";
    Drawing::new(outline, 0x5b93d3, INK, line_width, seed)
        // The crown's shade side and the dent of the pinch.
        .area("M70 40C72 -10 62 -90 20 -74C36 -54 40 -8 28 48Z", 0x3f76bc)
        .area("M-4 -51C1 -53 6 -57 13 -62C20 -58 16 -40 6 -22C-3 -28 -6 -40 -4 -51Z", 0x2f5c9c)
        .area("M-50 -34C-47 -50 -40 -58 -33 -58C-38 -44 -44 -22 -47 4C-51 0 -52 -18 -50 -34Z", 0x9cc6f0)
        .line("M-4 -51C-7 -40 -4 -29 4 -20M13 -62C18 -54 15 -42 10 -33", 0.9)
        .line("M-24 -40C-30 -20 -32 -6 -32 4", 0.5)
        // The band, its shade and its upper light.
        .area("M-66 10C-36 25 30 25 64 6L66 60H-66Z", 0x7b2244)
        .area("M22 17.5C40 15 54 10 66 4L68 60H25Z", 0x571333)
        .area("M-61 15C-52 20 -40 22.5 -26 23.5L-26 27C-40 26 -52 23 -61 18.5Z", 0xb04a6c)
        .line("M-63 11C-36 25 30 25 61 7", 0.8)
        // The feather and its quill.
        .area("M30 38C16 14 14 -16 30 -44C44 -22 48 8 36 38Z", 0xe8503a)
        .area("M33 38C32 8 31 -20 30 -44C44 -22 48 8 36 38Z", 0xc23228)
        .brush("M33 40C32 8 31 -16 30 -38", 1.8, 0xffd9a0)
        .line("M30 38C16 14 14 -16 30 -44C44 -22 48 8 36 38M20 -2L27 4M19 10L28 17M42 4L36 10M42 16L36 22M38 -22L33 -14", 0.62)
        // The bow.
        .area("M-20 20C-32 12 -44 14 -45 22C-46 34 -38 40 -22 32ZM-16 20C-4 10 10 12 12 20C14 32 4 40 -14 32Z", 0xa8386a)
        .line("M-20 20C-32 12 -44 14 -45 22C-46 34 -38 40 -22 32M-14 20C-4 10 10 12 12 20C14 32 4 40 -14 32", 0.8)
        .area("M-26 17C-16 15 -11 19 -11 27C-11 35 -18 37 -25 34C-29 30 -30 22 -26 17Z", 0xc45c84)
        .line("M-26 17C-16 15 -11 19 -11 27C-11 35 -18 37 -25 34C-29 30 -30 22 -26 17ZM-32 22L-40 24M-4 22L5 22M-33 29L-38 31", 0.62)
        // The brim in front of the crown, its underside, and light along its edge.
        .area("M-130 -20L-62 33C-36 50 34 49 60 30L130 -20V90H-130Z", 0x5b93d3)
        .area("M-62 33C-36 50 34 49 60 30C44 55 -40 59 -62 33Z", 0x3f76bc)
        .area("M-120 20C-100 50 -46 62 4 59C56 56 96 43 118 8L120 80H-120Z", 0x3a6db1)
        .area("M-98 30C-84 44 -60 51 -36 53C-60 47 -80 38 -92 24Z", 0x9cc6f0)
        .line("M-62 33C-36 50 34 49 60 30", 1.15)
        .line("M98 10C104 16 102 22 96 28M-97 16C-104 20 -102 27 -96 32", 0.8)
}

/// A ball of 40 units radius with a blue band and a star.
pub(super) fn ball(line_width: f64, seed: u64) -> Drawing {
    Drawing::new("M40 0A40 40 0 1 1 -40 0A40 40 0 1 1 40 0Z", 0xf0a818, INK, line_width, seed)
        .area("M-50 -17C-20 -7 20 -7 50 -17L50 17C20 27 -20 27 -50 17Z", 0xd8322c)
        .area("M-50 -12C-20 -2 20 -2 50 -12L50 -17C20 -7 -20 -7 -50 -17ZM-50 17C-20 27 20 27 50 17V12C20 22 -20 22 -50 12Z", 0xffe06a)
        .area("M0 -17L5.9 -4.1L20 -2.500L9.500 7.100L12.300 21L0 14L-12.300 21L-9.500 7.100L-20 -2.500L-5.900 -4.100Z", 0xffe06a)
        .area("M44 -24C34 22 -6 44 -34 34C-10 54 52 40 44 -24Z", 0xb06a10)
        .area("M38 2C35 20 24 33 8 39L30 38L46 10Z", 0x8a1f26)
        .area("M-27 -20C-22 -29 -13 -34 -4 -34C-12 -29 -20 -22 -24 -14C-28 -14 -29 -17 -27 -20Z", 0xffe9a8)
        .line("M-41 -14C-20 -7 20 -7 41 -14M-41 14C-20 27 20 27 41 14", 0.7)
        .line("M0 -17L5.9 -4.1L20 -2.500L9.500 7.100L12.300 21L0 14L-12.300 21L-9.500 7.100L-20 -2.500L-5.900 -4.100Z", 0.55)
}

/// A witch's tall bent hat with a buckle, registered to the felt hat: the same brim and base of the crown.
pub(super) fn witch_hat(line_width: f64, seed: u64) -> Drawing {
    let outline = "M-124 24C-106 58 -48 68 4 66C58 64 106 50 126 16C130 6 121 1 111 9C98 19 78 26 60 30C54 4 44 -26 36 -58C46 -74 62 -80 76 -78\
                   C84 -78 85 -86 77 -90C58 -104 34 -118 12 -112C-10 -106 -22 -84 -30 -52C-36 -26 -50 6 -62 33C-80 32 -98 24 -108 14C-117 5 -131 11 -124 24Z";
    Drawing::new(outline, 0x6254a0, INK, line_width, seed)
        .area("M70 40C58 0 44 -30 40 -62C54 -84 80 -66 96 -84L60 -104C30 -108 14 -90 16 -60C18 -20 26 16 24 50Z", 0x463a7c)
        .area("M-22 -50C-16 -78 -6 -98 12 -104C-2 -88 -10 -66 -16 -40C-22 -20 -30 -4 -38 8C-40 0 -28 -24 -22 -50Z", 0x9c8cd6)
        .area("M24 -42L40 -48L45 -30L28 -24Z", 0xc87850)
        .line("M36 -58C28 -52 18 -54 8 -60M30 -74C22 -70 14 -72 8 -76M-30 -52C-20 -46 -12 -46 -4 -50M40 -72C50 -76 60 -76 68 -80", 0.8)
        .line("M40 -48L24 -42L28 -24L44 -30M22 -35L30 -37M24 -29L31 -31M33 -41L34 -49M38 -25L37 -32", 0.6)
        // The band and its buckle.
        .area("M-60 6C-30 20 28 20 60 2L70 60H-74Z", 0x4f9a52)
        .area("M18 15C34 13 46 9 60 2L68 60H22Z", 0x2f7041)
        .line("M-53 9C-30 21 28 20 54 5", 0.8)
        // The brim in front of the crown, its underside, and light along its edge.
        .area("M-140 -20L-62 33C-36 50 34 49 60 30L140 -20V90H-140Z", 0x6254a0)
        .area("M-62 33C-36 50 34 49 60 30C44 56 -40 60 -62 33Z", 0x463a7c)
        .area("M-130 20C-108 54 -48 65 4 62C58 59 104 45 132 8L134 84H-134Z", 0x3a3066)
        .area("M-112 28C-94 44 -66 53 -38 55C-66 49 -90 39 -106 22Z", 0x9c8cd6)
        .line("M-62 33C-36 50 34 49 60 30", 1.15)
        .area("M-22 12L18 11L20 45L-24 46Z", 0xf2c23e)
        .area("M12 12L18 11L20 45L14 45Z", 0xc08a1e)
        .area("M-12 21L9 20L10 36L-13 37Z", 0x2f7041)
        .line("M-22 12L18 11L20 45L-24 46ZM-12 21L9 20L10 36L-13 37Z", 0.8)
        .line("M111 9C118 15 116 22 108 28M-108 14C-116 19 -114 27 -107 32", 0.8)
}

/// A ring of dough with pink icing and sprinkles, of the ball's size.
pub(super) fn donut(line_width: f64, seed: u64) -> Drawing {
    let hole = "M12 -1A12 10.500 0 1 0 -12 -1A12 10.500 0 1 0 12 -1Z";
    let mut drawing = Drawing::new(&format!("M42 0A42 40 0 1 1 -42 0A42 40 0 1 1 42 0Z{hole}"), 0xe0a050, INK, line_width, seed)
        .area("M46 -6C42 28 14 42 -12 38C-26 36 -36 28 -40 18C-40 44 -6 54 20 46C44 38 52 8 46 -6Z", 0xb8742c)
        .area(
            "M37 -4C38 6 35 12 31 13C27 14 26 19 27 23C28 28 22 31 18 27C14 24 11 27 9 31C6 36 -1 35 -3 30C-5 26 -9 25 -13 28C-18 31 -24 27 -23 22\
             C-22 17 -27 15 -31 13C-36 9 -38 2 -37 -5C-35 -25 -20 -36 0 -36C20 -36 36 -24 37 -4Z",
            0xf27aa8,
        )
        .area("M37 -4C38 6 35 12 31 13C27 14 26 19 27 23C28 28 22 31 18 27C14 24 11 27 9 31C6 36 2 34 4 27C8 18 22 16 26 4C30 -8 28 -20 22 -30C32 -24 36 -14 37 -4Z", 0xd4588c)
        .area("M-28 -12C-24 -24 -14 -30 -4 -30C-14 -26 -22 -20 -25 -8C-28 -6 -29 -8 -28 -12Z", 0xffc4dc)
        .area("M-15 -1A15.500 13.500 0 0 1 15 -1A13 11 0 0 0 -15 -1Z", 0xb8742c)
        .area("M-16 2A16 14 0 0 0 16 2A13 11 0 0 1 -16 2Z", 0xffc4dc);
    let sprinkles = [
        (0xfff3c0, "M-30 4L-25 8M2 -31L8 -28M22 -4L20 2M-8 18L-3 21"),
        (0x58b8e8, "M-20 -24L-22 -18M14 -24L19 -20M-14 14L-19 18M30 2L31 8"),
        (0x6cc85a, "M-33 -6L-29 -9M-6 -22L0 -20M24 -17L29 -13M12 18L17 15"),
        (0xf8d034, "M-22 -3L-21 3M10 -17L15 -16M20 9L23 14M-26 11L-22 15"),
        (0x7a4ac8, "M-12 -31L-8 -28M25 -26L27 -22M1 22L6 20M-17 -14L-13 -17"),
    ];
    for (colour, data) in sprinkles {
        drawing = drawing.brush(data, 4.6, INK).brush(data, 3.4, colour);
    }
    drawing.line(
        "M37 -4C38 6 35 12 31 13C27 14 26 19 27 23C28 28 22 31 18 27C14 24 11 27 9 31C6 36 -1 35 -3 30C-5 26 -9 25 -13 28C-18 31 -24 27 -23 22\
         C-22 17 -27 15 -31 13C-36 9 -38 2 -37 -5",
        0.7,
    )
}

/// A lit orange of the ball's size, with pores, a stalk's scar, a highlight and the noise of a sensor: RGBA, linear, premultiplied.
pub(super) fn orange(width: usize, height: usize, scale: f64, seed: u64) -> Vec<f32> {
    let mut image = vec![0.0; width * height * 4];
    let centre = Point::new(width as f64 / 2.0, height as f64 / 2.0);
    let disc = Affine::translate(centre.to_vec2()) * Affine::scale(scale) * Circle::new((0.0, 0.0), 40.5).to_path(1e-4);
    if let Ok(mut canvas) = Canvas::new(&mut image, width, height) {
        canvas.fill_with(&disc, FillRule::NonZero, |i, j| {
            let x = (i as f64 + 0.5 - centre.x) / (scale * 40.5);
            let y = (j as f64 + 0.5 - centre.y) / (scale * 40.5);
            orange_light(x, y, seed)
        });
    }
    image
}

/// Light from the orange's point seen at (x, y) on the unit disc.
fn orange_light(x: f64, y: f64, seed: u64) -> [f32; 4] {
    let z = (1.0 - x * x - y * y).max(0.0).sqrt();
    // Pores are laid out on the sphere seen slightly from above, so that they crowd towards its rim.
    let (u, v) = (libm::atan2(x, z) * 15.0, libm::asin(y.clamp(-1.0, 1.0)) * 15.0);
    let pore = |u: f64, v: f64| 0.65 * noise(u * 1.7, v * 1.7, seed) + 0.5 * noise(u * 3.1, v * 3.1, seed ^ 3);
    let (bump_x, bump_y) = (pore(u + 0.12, v) - pore(u - 0.12, v), pore(u, v + 0.12) - pore(u, v - 0.12));
    let scar = libm::exp(-((x - 0.16) * (x - 0.16) * 160.0 + (y + 0.66) * (y + 0.66) * 420.0));
    let (nx, ny, nz) = (x + 0.32 * bump_x, y + 0.32 * bump_y, z + 0.05);
    let length = (nx * nx + ny * ny + nz * nz).sqrt();
    let lambert = ((-0.50 * nx - 0.62 * ny + 0.60 * nz) / length).max(0.0);
    let sheen = libm::pow(((-0.27 * nx - 0.335 * ny + 0.90 * nz) / length).clamp(0.0, 1.0), 46.0);
    let bounce = smoothstep(0.1, 1.0, y) * 0.09;
    let mottle = 1.0 + 0.10 * fbm(x * 3.0, y * 3.0, 3, seed ^ 9);
    let fresnel = libm::pow(1.0 - z, 3.0) * 0.10 * (0.4 - 0.6 * y);
    let skin = [0.90, 0.300 - 0.05 * (1.0 - lambert), 0.018];
    let light = |c: usize, warm: f64| {
        let body = skin[c] * mottle * (0.045 + 1.02 * lambert * warm + bounce * [0.9, 0.8, 0.6][c]);
        let scarred = body + (([0.16, 0.17, 0.05][c]) * (0.2 + lambert) - body) * (scar * 1.4).min(1.0);
        (scarred + 0.42 * sheen * (1.0 - scar) + fresnel.max(0.0)) as f32
    };
    [light(0, 1.0), light(1, 0.97), light(2, 0.9), 1.0]
}

/// Ink of the drawings, linear.
pub(super) fn shadow_colour() -> [f32; 4] {
    hex(0x160f1c)
}
