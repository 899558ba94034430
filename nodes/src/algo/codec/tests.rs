//! Round trips, hostile bytes, and real files where they are at hand.

use super::*;

/// Samples without pattern in [0, 1), the same on every machine.
fn noise(count: usize) -> Vec<f32> {
    let mut state = 0x2545_f491u32;
    let next = || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        (state >> 8) as f32 / (1u32 << 24) as f32
    };
    std::iter::repeat_with(next).take(count).collect()
}

fn channels(n: usize) -> &'static [&'static str] {
    [&["Y"][..], &["Y", "A"], &["R", "G", "B"], &["R", "G", "B", "A"]][n - 1]
}

/// A premultiplied picture: colours are noise times alpha.
fn picture(width: usize, height: usize, n: usize) -> Picture {
    let mut pixels = noise(width * height * n);
    if n.is_multiple_of(2) {
        for pixel in pixels.chunks_exact_mut(n) {
            let alpha = pixel[n - 1];
            pixel[..n - 1].iter_mut().for_each(|v| *v *= alpha);
        }
    }
    Picture::new(pixels, width, height, channels(n)).unwrap()
}

fn options(format: Format, depth: Depth) -> EncodeOptions {
    EncodeOptions { depth: Some(depth), ..EncodeOptions::new(format) }
}

fn round_trip(picture: &Picture, options: &EncodeOptions) -> Picture {
    let bytes = encode_to_vec(picture, options).unwrap();
    assert_eq!(sniff(&bytes), Some(options.format));
    let header = probe(Cursor::new(&bytes), &DecodeOptions::default()).unwrap();
    let read = decode(&bytes, &DecodeOptions { color: options.color, ..Default::default() }).unwrap();
    assert_eq!((header.width, header.height, &header.channels), (read.width, read.height, &read.channels));
    assert_eq!((header.data_window, header.display_window), (read.data_window, read.display_window));
    assert_eq!((header.format, header.depth), (options.format, options.depth().unwrap()));
    read
}

#[test]
fn a_text_beside_the_picture_is_read_again() {
    let said = "Graph(doc: \"a graph of more than Latin 1: \u{3b1}\", ...)".repeat(40);
    for format in [Format::Png, Format::Exr] {
        let picture = Picture::new(vec![0.5; 12], 2, 2, &["R", "G", "B"]).unwrap();
        let plain = encode_to_vec(&picture, &EncodeOptions::new(format)).unwrap();
        let options = EncodeOptions { text: Some(("made_by", said.as_str().into())), ..EncodeOptions::new(format) };
        let bytes = encode_to_vec(&picture, &options).unwrap();
        assert_eq!(
            (super::text(&plain, "made_by"), super::text(&bytes, "made_by"), super::text(&bytes, "other")),
            (None, Some(said.clone()), None)
        );
        let read = |bytes: &[u8]| decode(bytes, &DecodeOptions::default()).unwrap();
        assert_eq!(read(&plain).pixels, read(&bytes).pixels);
    }
    assert_eq!(super::text(b"no picture at all", "made_by"), None);
}

const SIZES: [(usize, usize); 5] = [(1, 1), (1, 9), (17, 1), (33, 19), (300, 131)];

#[test]
fn integers_come_back_to_the_code() {
    for format in [Format::Png, Format::Tiff] {
        for (depth, max) in [(Depth::U8, 255.0f64), (Depth::U16, 65535.0)] {
            for n in 1..=4 {
                for (w, h) in SIZES {
                    let first = round_trip(&picture(w, h, n), &options(format, depth));
                    // What was read stands exactly on codes, so the second trip must change nothing.
                    let second = round_trip(&first, &options(format, depth));
                    assert_eq!(first, second, "{format:?} {depth:?} {n} {w}x{h}");
                    let original = picture(w, h, n);
                    for (i, (a, b)) in original.pixels.iter().zip(&first.pixels).enumerate() {
                        let pixel = &original.pixels[i / n * n..][..n];
                        let alpha = if n.is_multiple_of(2) { f64::from(pixel[n - 1]) } else { 1.0 };
                        // Half a code of each factor: the sRGB curve is at most 2.4/1.055 codes of light steep.
                        let bound = (0.5 / max) * (2.3 * alpha + 1.0) + 1e-6;
                        assert!((f64::from(*a) - f64::from(*b)).abs() <= bound.max(1.2 / max), "{format:?} {depth:?} {n}: {a} {b}");
                    }
                }
            }
        }
    }
}

#[test]
fn every_code_of_8_and_16_bits_survives_with_and_without_alpha() {
    for format in [Format::Png, Format::Tiff] {
        for (depth, max) in [(Depth::U8, 255usize), (Depth::U16, 65535)] {
            let table = curve::Curve::Srgb.table(max as u16);
            let grey = Picture::new(table.to_vec(), max + 1, 1, &["Y"]).unwrap();
            assert_eq!(round_trip(&grey, &options(format, depth)).pixels, grey.pixels);
            for alpha_code in [1, 2, 77, max / 2, max] {
                let alpha = (alpha_code as f64 / max as f64) as f32;
                let pixels: Vec<f32> = table.iter().flat_map(|v| [v * alpha, alpha]).collect();
                let straight = Picture::new(pixels, max + 1, 1, &["Y", "A"]).unwrap();
                assert_eq!(round_trip(&straight, &options(format, depth)).pixels, straight.pixels, "{format:?} {depth:?} {alpha_code}");
            }
        }
    }
}

fn extremes(n: usize) -> Picture {
    let mut wide = picture(37, 21, n);
    let values = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.0, -7.5, 65504.0, 6e-8, 1e-3, 1.0e3, 0.333];
    wide.pixels.iter_mut().zip(values.iter().cycle()).step_by(3).for_each(|(to, v)| *to = *v);
    wide
}

fn same_bits(a: &[f32], b: &[f32]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan()))
}

#[test]
fn floats_come_back_bit_for_bit() {
    use Compression::*;
    for n in 1..=4 {
        let wide = extremes(n);
        for (format, packings) in [(Format::Tiff, &[Auto, None][..]), (Format::Exr, &[Auto, None, Rle, Zips, Zip, Piz, B44][..])] {
            for &compression in packings {
                let float = EncodeOptions { compression, ..options(format, Depth::Float) };
                let read = round_trip(&wide, &float);
                assert!(same_bits(&read.pixels, &wide.pixels), "{format:?} {compression:?} {n}");
                assert_eq!(read.channels, wide.channels);
            }
        }
    }
}

#[test]
fn halves_are_rounded_to_nearest_and_stay() {
    use Compression::*;
    let wide = extremes(4);
    let rounded: Vec<f32> = wide.pixels.iter().map(|v| half::f16::from_f32(*v).to_f32()).collect();
    for (format, packings) in [(Format::Tiff, &[Auto, None][..]), (Format::Exr, &[None, Rle, Zips, Zip, Piz, Pxr24][..])] {
        for &compression in packings {
            let read = round_trip(&wide, &EncodeOptions { compression, ..options(format, Depth::Half) });
            assert!(same_bits(&read.pixels, &rounded), "{format:?} {compression:?}");
        }
    }
}

#[test]
fn lossy_compression_is_refused_unless_permitted() {
    let ramp = (0..64 * 64).flat_map(|i| [(i % 64) as f32 / 64.0, (i / 64) as f32 / 64.0, 0.5]).collect();
    let p = Picture::new(ramp, 64, 64, channels(3)).unwrap();
    for (compression, depth) in [(Compression::Pxr24, Depth::Float), (Compression::B44, Depth::Half), (Compression::B44a, Depth::Half)] {
        let mut o = EncodeOptions { compression, ..options(Format::Exr, depth) };
        let error = encode_to_vec(&p, &o).unwrap_err().to_string();
        assert!(error.starts_with(&format!("exr cannot hold {} samples exactly with {} compression", depth.name(), compression.name())));
        o.lossy = true;
        let read = round_trip(&p, &o);
        // B44 keeps 6 bits of the differences within a block of 4 by 4.
        assert!(read.pixels.iter().zip(&p.pixels).all(|(a, b)| (a - b).abs() < 0.05), "{compression:?}");
    }
}

#[test]
fn exr_keeps_windows_and_channel_names() {
    let names = ["R", "G", "B", "A", "Z", "forward.left.u", "forward.left.v"];
    let mut p = Picture::new(noise(5 * 4 * 7), 5, 4, &names).unwrap();
    p.data_window = [-3, 20, 2, 24];
    p.display_window = [0, 0, 1920, 1080];
    let bytes = encode_to_vec(&p, &options(Format::Exr, Depth::Float)).unwrap();
    let read = |layer: Option<&str>| decode(&bytes, &DecodeOptions { layer: layer.map(String::from), ..Default::default() });
    let main = read(None).unwrap();
    assert_eq!((main.data_window, main.display_window), (p.data_window, p.display_window));
    assert_eq!(main.channels, ["R", "G", "B", "A"]);
    assert_eq!(main.pixels[4..8], p.pixels[7..11]);
    assert_eq!(main.notes, ["further layers: forward.left, Z"]);
    let motion = read(Some("forward.left")).unwrap();
    assert_eq!((motion.channels, &motion.pixels[2..4]), (vec!["u".to_string(), "v".into()], &p.pixels[12..14]));
    assert_eq!(read(Some("Z")).unwrap().pixels[1], p.pixels[11]);
    assert_eq!(read(Some("forward.left.v")).unwrap().pixels[1], p.pixels[13]);
    let all = read(Some("*")).unwrap();
    assert_eq!(all.channels, ["A", "B", "G", "R", "Z", "forward.left.u", "forward.left.v"]);
    let error = read(Some("forward.lefft")).unwrap_err().to_string();
    assert_eq!(error, "expected one of the layers forward.left, Z, found the layer `forward.lefft`; did you mean `forward.left`?");
}

#[test]
fn colour_under_no_alpha_is_lost_in_integers_and_kept_in_floats() {
    let glow = Picture::new(vec![0.5, 0.25, 1.0, 0.0], 1, 1, channels(4)).unwrap();
    for format in [Format::Png, Format::Tiff] {
        assert_eq!(round_trip(&glow, &options(format, Depth::U8)).pixels, [0.0; 4]);
    }
    assert_eq!(round_trip(&glow, &options(Format::Exr, Depth::Half)).pixels, glow.pixels);
    // As data, nothing is multiplied: the codes go through as they are.
    let data = EncodeOptions { color: ColorMode::Data, ..options(Format::Png, Depth::U8) };
    assert_eq!(round_trip(&glow, &data).pixels, [128.0 / 255.0, 64.0 / 255.0, 1.0, 0.0]);
}

#[test]
fn colours_brighter_than_their_alpha_are_clamped() {
    let p = Picture::new(vec![0.9, 0.2, 0.1, 0.5], 1, 1, channels(4)).unwrap();
    let read = round_trip(&p, &options(Format::Png, Depth::U16));
    assert_eq!((read.pixels[0], read.pixels[3]), (read.pixels[3], (32768.0f64 / 65535.0) as f32));
}

#[test]
fn nan_is_clamped_or_refused() {
    let mut p = picture(3, 2, 3);
    p.pixels[10] = f32::NAN;
    p.pixels[0] = f32::INFINITY;
    p.pixels[1] = f32::NEG_INFINITY;
    let read = round_trip(&p, &options(Format::Png, Depth::U8));
    assert_eq!((read.pixels[0], read.pixels[1], read.pixels[10]), (1.0, 0.0, 0.0));
    let refuse = EncodeOptions { non_finite: NonFinite::Refuse, ..options(Format::Png, Depth::U8) };
    let error = encode_to_vec(&p, &refuse).unwrap_err().to_string();
    assert_eq!(error, "expected finite samples, found inf in channel R at column 0, row 0; integers cannot hold it");
}

#[test]
fn colour_modes_apply_the_curve_or_leave_it() {
    let p = Picture::new(vec![0.5, 0.25, 0.125], 1, 1, channels(3)).unwrap();
    let linear = EncodeOptions { color: ColorMode::Linear, ..options(Format::Png, Depth::U16) };
    let bytes = encode_to_vec(&p, &linear).unwrap();
    let read = |color| decode(&bytes, &DecodeOptions { color, ..Default::default() }).unwrap().pixels;
    // The file says gAMA 1.0, so that reading it without further word gives light again.
    assert_eq!(read(ColorMode::Auto), read(ColorMode::Linear));
    assert_eq!(read(ColorMode::Data), read(ColorMode::Linear));
    assert!((read(ColorMode::Auto)[0] - 0.5).abs() < 1e-5);
    assert!((read(ColorMode::Srgb)[0] - 0.214_041).abs() < 1e-4);
    for format in [Format::Exr, Format::Tiff] {
        let curved = EncodeOptions { color: ColorMode::Srgb, ..options(format, Depth::Float) };
        let bytes = encode_to_vec(&p, &curved).unwrap();
        assert!((decode(&bytes, &DecodeOptions::default()).unwrap().pixels[0] - 0.735_357).abs() < 1e-5);
        let back = decode(&bytes, &DecodeOptions { color: ColorMode::Srgb, ..Default::default() }).unwrap();
        assert!((back.pixels[2] - 0.125).abs() < 1e-6);
    }
}

#[test]
fn ordered_dither_keeps_the_mean_and_leaves_codes_alone() {
    let dithered = EncodeOptions { dither: Dither::Ordered, color: ColorMode::Linear, ..options(Format::Png, Depth::U8) };
    let flat = |v: f32| Picture::new(vec![v; 64 * 64], 64, 64, &["Y"]).unwrap();
    for step in 0..=16u16 {
        let level = (100.0 + f32::from(step) / 16.0) / 255.0;
        let read = round_trip(&flat(level), &dithered);
        let mean = read.pixels.iter().map(|v| f64::from(*v)).sum::<f64>() / 4096.0;
        // 64 thresholds resolve a 64th of a code.
        assert!((mean - f64::from(level)).abs() * 255.0 < 1.0 / 64.0 + 1e-3, "{step}: {mean} {level}");
        if step % 16 == 0 {
            assert!(read.pixels.iter().all(|v| *v == read.pixels[0]));
        }
    }
}

#[test]
fn bytes_do_not_depend_on_threads() {
    let p = picture(290, 230, 4);
    for format in Format::ALL {
        for &depth in format.depths() {
            let mut p = p.clone();
            if format == Format::Jpeg {
                p = picture(290, 230, 3);
            }
            let bytes = |threads| encode_to_vec(&p, &EncodeOptions { threads, ..options(format, depth) }).unwrap();
            let one = bytes(1);
            assert_eq!(one, bytes(5), "{format:?} {depth:?}");
            let read = |threads| decode(&one, &DecodeOptions { threads, ..Default::default() }).unwrap();
            assert_eq!(read(1), read(3));
        }
    }
}

#[test]
fn jpeg_is_near_at_high_quality_and_takes_no_alpha() {
    let ramp: Vec<f32> = (0..48 * 40).flat_map(|i| [(i % 48) as f32 / 48.0, (i / 48) as f32 / 40.0, 0.25]).collect();
    let p = Picture::new(ramp, 48, 40, channels(3)).unwrap();
    let read = round_trip(&p, &EncodeOptions { quality: 100, ..options(Format::Jpeg, Depth::U8) });
    let worst = read.pixels.iter().zip(&p.pixels).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 0.03, "{worst}");
    let error = encode_to_vec(&picture(2, 2, 4), &options(Format::Jpeg, Depth::U8)).unwrap_err().to_string();
    assert_eq!(error, "jpeg cannot hold the channels R G B A; it takes one channel or R G B: drop the alpha, or write png, tiff or exr");
}

#[test]
fn combinations_that_do_not_exist_name_the_choices() {
    let error = |o: EncodeOptions| encode_to_vec(&picture(2, 2, 3), &o).unwrap_err().to_string();
    assert_eq!(error(options(Format::Png, Depth::Half)), "png cannot hold depth half; it takes u8, u16");
    assert_eq!(error(options(Format::Exr, Depth::U8)), "exr cannot hold depth u8; it takes half, float");
    let piz = EncodeOptions { compression: Compression::Piz, ..EncodeOptions::new(Format::Png) };
    assert_eq!(error(piz), "png cannot hold compression piz; it takes auto, zip, none");
    let motion = Picture::new(noise(8), 2, 2, &["u", "v"]).unwrap();
    let error = encode_to_vec(&motion, &EncodeOptions::new(Format::Png)).unwrap_err().to_string();
    assert_eq!(error, "png cannot hold the channels u v; it takes one channel, Y A, R G B or R G B A");
}

#[test]
fn pictures_that_contradict_themselves_are_refused() {
    let encode = |p: &Picture| encode_to_vec(p, &EncodeOptions::new(Format::Exr)).map_err(|e| e.to_string());
    assert_eq!(
        encode(&Picture::default()).unwrap_err(),
        "expected a picture with at least one pixel and one channel, found 0x0 with 0 channels"
    );
    let mut p = picture(2, 2, 3);
    p.pixels.pop();
    assert_eq!(encode(&p).unwrap_err(), "expected a picture with 2 x 2 x 3 samples, found 11");
    let mut p = picture(2, 2, 3);
    p.channels[1] = "R".into();
    assert_eq!(encode(&p).unwrap_err(), "expected a picture with unique channel names, found R twice");
    let mut p = picture(2, 2, 3);
    p.data_window[2] = 9;
    assert_eq!(encode(&p).unwrap_err(), "expected a picture with a data window of 2x2, found 9x2");
    p.data_window = [i32::MAX - 2, 0, i32::MAX, 2];
    assert!(encode(&p).unwrap_err().starts_with("expected a picture with windows and channel names that an exr can hold"));
}

#[test]
fn other_files_are_named() {
    let error = |bytes: &[u8]| decode(bytes, &DecodeOptions::default()).unwrap_err().to_string();
    assert_eq!(error(b""), "expected a png, jpeg, tiff or exr file, found an empty file");
    assert_eq!(error(b"GIF89a\x01\x00"), "expected a png, jpeg, tiff or exr file, found a gif file: convert its frames to png");
    assert_eq!(error(b"\x01\x02xyz"), "expected a png, jpeg, tiff or exr file, found a file that starts with the bytes 01 02 78 79 7a");
}

/// Small files of every format, made here.
fn small_files() -> Vec<(String, Vec<u8>)> {
    let mut files = Vec::new();
    for format in Format::ALL {
        for &depth in format.depths() {
            for &compression in format.compressions() {
                let p = picture(9, 7, if format == Format::Jpeg { 3 } else { 4 });
                let o = EncodeOptions { compression, lossy: true, ..options(format, depth) };
                files.push((format!("{format:?} {depth:?} {compression:?}"), encode_to_vec(&p, &o).unwrap()));
            }
        }
    }
    files
}

#[test]
fn every_truncation_is_an_error_and_never_a_panic() {
    for (name, bytes) in small_files() {
        for len in 0..bytes.len() {
            match decode(&bytes[..len], &DecodeOptions { threads: 1, ..Default::default() }) {
                Err(CodecError::Corrupt { .. } | CodecError::UnknownFormat { .. } | CodecError::Unsupported { .. }) => {}
                other => panic!("{name} cut to {len} of {}: {other:?}", bytes.len()),
            }
        }
    }
}

#[test]
fn damaged_bytes_are_read_or_refused_and_never_a_panic() {
    let o = DecodeOptions { max_samples: 1 << 20, threads: 1, ..Default::default() };
    for (name, bytes) in small_files() {
        for at in 0..bytes.len().min(1500) {
            let mut damaged = bytes.clone();
            damaged[at] ^= [0x01, 0x80, 0xff][at % 3];
            if let Ok(p) = decode(&damaged, &o) {
                assert_eq!(p.pixels.len(), p.width * p.height * p.channels.len(), "{name} at {at}");
            }
            let _ = probe(Cursor::new(&damaged), &o);
        }
    }
}

/// The folder of real files beside the workspace, where there is one.
fn shared(folder: &str) -> Option<std::path::PathBuf> {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().skip(1).map(|up| up.join("../shared/data"));
    let found = root.take(3).map(|up| up.join(folder)).find(|path| path.is_dir());
    if found.is_none() {
        println!("skipped: no ../shared/data/{folder} beside the workspace");
    }
    found
}

fn files_under(folder: &std::path::Path, into: &mut Vec<std::path::PathBuf>) {
    let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() { files_under(&path, into) } else { into.push(path) }
    }
}

/// Reads every file of a folder; those that are not pictures, and the two pictures named here, must be refused with these words.
fn read_all(folder: &str) {
    let Some(root) = shared(folder) else { return };
    let mut files = Vec::new();
    files_under(&root, &mut files);
    for path in files {
        let bytes = std::fs::read(&path).unwrap();
        let extension = path.extension().and_then(|e| e.to_str()).and_then(Format::from_extension);
        let header = probe(Cursor::new(&bytes), &DecodeOptions::default()).map_err(|e| e.to_string());
        let read = decode(&bytes, &DecodeOptions::default()).map_err(|e| e.to_string());
        let expected_error = match path.file_name().and_then(|n| n.to_str()) {
            Some("XYZ_YC.exr") => {
                Some("exr with subsampled channels (luminance and chroma: Y, RY, BY) is not supported; convert it to RGB first")
            }
            Some("Trunks.exr") => Some("exr with deep data is not supported; flatten it first"),
            _ if extension.is_none() => Some("expected a png, jpeg, tiff or exr file, found "),
            _ => None,
        };
        match (read, header, expected_error) {
            (Ok(p), Ok(h), None) => assert_eq!((p.width, p.height, p.channels, p.notes), (h.width, h.height, h.channels, h.notes)),
            (Err(read), Err(header), Some(expected)) => assert!(read.starts_with(expected) && header.starts_with(expected), "{read}"),
            other => panic!("{}: {:?}", path.display(), other.0.map(|p| p.channels)),
        }
    }
}

#[test]
fn real_exr_files_are_read_or_refused_clearly() {
    read_all("exr");
}

#[test]
fn real_plates_are_read() {
    read_all("plates");
}

#[test]
fn real_drawings_are_read_or_refused_clearly() {
    read_all("drawings");
}

#[test]
fn real_cartoons_and_hostile_files_are_read_or_refused_clearly() {
    read_all("cartoons");
    read_all("hostile/images_image_rs");
}

/// Figures of OpenEXR 3.5.3 (its Python module): the sum of the finite samples of a channel in f64, and samples at columns and rows of the data window.
type Figures = (&'static str, Option<&'static str>, &'static str, f64, &'static [(usize, usize, f32)]);

const OPENEXR_FIGURES: [Figures; 15] = [
    ("Beachball/singlepart.0001.exr", None, "R", 172_915.648_106_455_8, &[(400, 400, 0.0), (500, 700, 0.5)]),
    ("Beachball/singlepart.0001.exr", Some("forward.left"), "u", 24_873_460.906_25, &[(400, 400, 43.25), (500, 700, 42.28125)]),
    ("Beachball/singlepart.0001.exr", Some("whitebarmask.left.mask"), "mask", 176_967.937_920_153_14, &[(500, 700, 0.991_699_2)]),
    ("Beachball/multipart.0001.exr", None, "R", 172_915.648_106_455_8, &[(400, 400, 0.0), (500, 700, 0.5)]),
    ("Chromaticities/Rec709.exr", None, "R", 90_460.470_310_211_18, &[(0, 0, 0.283_447_27), (300, 200, 1.385_742_2)]),
    ("MultiResolution/ColorCodedLevels.exr", None, "R", 129_648.203_481_495_38, &[(0, 0, 0.218_627_93), (300, 200, 0.999_511_7)]),
    ("MultiResolution/OrientationLatLong.exr", None, "B", 502_087.210_339_307_8, &[(0, 0, 8.702_278e-6), (300, 200, 0.990_722_66)]),
    ("LuminanceChroma/Garden.exr", None, "Y", 143_961.451_538_085_94, &[(300, 200, 0.684_570_3), (873, 492, 0.078_491_21)]),
    ("TestImages/GammaChart.exr", None, "G", 112_500.0, &[(300, 200, 0.5), (799, 799, 0.03125)]),
    ("TestImages/AllHalfValues.exr", None, "R", 0.0, &[(200, 100, 1224.0), (255, 255, f32::NAN)]),
    ("TestImages/BrightRingsNanInf.exr", None, "G", 17_654_608.054_687_5, &[(0, 0, 0.5), (400, 400, 1.0)]),
    ("ScanLines/Carrots.exr", None, "G", 31_515.199_759_006_5, &[(0, 0, 0.135_375_98), (599, 399, 0.048_339_844)]),
    ("DisplayWindow/t05.exr", None, "G", 1102.0, &[(0, 0, 1.0), (399, 299, 1.0)]),
    ("MultiView/Fog.exr", None, "Y", 20_439.172_634_124_756, &[(300, 200, 0.021_850_586)]),
    ("MultiView/Fog.exr", Some("right"), "Y", 18_910.318_125_426_77, &[(300, 200, 0.005_496_978_8)]),
];

#[test]
fn exr_samples_equal_those_of_openexr() {
    let Some(root) = shared("exr") else { return };
    for (file, layer, channel, sum, points) in OPENEXR_FIGURES {
        let bytes = std::fs::read(root.join(file)).unwrap();
        let p = decode(&bytes, &DecodeOptions { layer: layer.map(String::from), ..Default::default() }).unwrap();
        let (n, c) = (p.channels.len(), p.channels.iter().position(|name| name == channel).unwrap());
        let found: f64 = p.pixels.iter().skip(c).step_by(n).filter(|v| v.is_finite()).map(|v| f64::from(*v)).sum();
        // The same halves summed in another order.
        assert!((found - sum).abs() <= 1e-9 * sum.abs().max(1.0), "{file} {channel}: {found} {sum}");
        for &(x, y, value) in points {
            let sample = p.pixels[(y * p.width + x) * n + c];
            assert!(sample == value || (sample.is_nan() && value.is_nan()), "{file} {channel} at {x} {y}: {sample} {value}");
        }
    }
}

#[test]
fn exr_parts_and_views_are_found_by_name() {
    let Some(root) = shared("exr") else { return };
    let bytes = std::fs::read(root.join("Beachball/multipart.0001.exr")).unwrap();
    let header = probe(Cursor::new(&bytes), &DecodeOptions::default()).unwrap();
    assert_eq!(header.data_window, [654, 245, 1531, 1121]);
    assert_eq!(header.display_window, [0, 0, 2048, 1556]);
    let names =
        "rgba_right depth_left forward_left whitebarmask_left rgba_left depth_right forward_right disparityL disparityR whitebarmask_right";
    assert_eq!(header.layers.join(" "), names);
    let probed = |layer: &str| probe(Cursor::new(&bytes), &DecodeOptions { layer: Some(layer.into()), ..Default::default() }).unwrap();
    assert_eq!((probed("forward_left").channels.join(" ").as_str(), probed("forward_left").data_window), ("u v", [688, 245, 1565, 1121]));
    assert_eq!(probed("rgba_left").data_window[0], 688);
    assert_eq!(probed("right").channels.join(" "), "R G B A");
}

/// A PNG put together by hand: header fields, then chunks, then the rows with their filter bytes.
fn png_file(size: [u32; 2], depth: u8, color: u8, interlaced: bool, chunks: &[(&[u8; 4], &[u8])], rows: &[u8]) -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut chunk = |name: &[u8; 4], data: &[u8]| {
        let mut crc = flate2::Crc::new();
        crc.update(name);
        crc.update(data);
        bytes.extend((data.len() as u32).to_be_bytes());
        bytes.extend(name);
        bytes.extend(data);
        bytes.extend(crc.sum().to_be_bytes());
    };
    let mut header = [size[0].to_be_bytes(), size[1].to_be_bytes()].concat();
    header.extend([depth, color, 0, 0, u8::from(interlaced)]);
    chunk(b"IHDR", &header);
    chunks.iter().for_each(|(name, data)| chunk(name, data));
    let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(rows).unwrap();
    chunk(b"IDAT", &packed.finish().unwrap());
    chunk(b"IEND", &[]);
    bytes
}

fn codes(bytes: &[u8]) -> (Vec<String>, Vec<u8>) {
    let p = decode(bytes, &DecodeOptions { color: ColorMode::Data, ..Default::default() }).unwrap();
    (p.channels, p.pixels.iter().map(|v| (v * 255.0).round() as u8).collect())
}

#[test]
fn png_of_few_bits_palettes_and_key_colours_are_read() {
    let (names, values) = codes(&png_file([9, 1], 1, 0, false, &[], &[0, 0b1010_0000, 0b1000_0000]));
    assert_eq!((names.join(" ").as_str(), values), ("Y", vec![255, 0, 255, 0, 0, 0, 0, 0, 255]));
    assert_eq!(codes(&png_file([3, 1], 2, 0, false, &[], &[0, 0b0001_1000])).1, [0, 85, 170]);
    assert_eq!(codes(&png_file([2, 1], 4, 0, false, &[], &[0, 0x1f])).1, [17, 255]);
    let palette: (&[u8; 4], &[u8]) = (b"PLTE", &[1, 2, 3, 40, 50, 60, 7, 8, 9]);
    let (names, values) = codes(&png_file([3, 1], 2, 3, false, &[palette], &[0, 0b0001_1000]));
    assert_eq!((names.join(" ").as_str(), values), ("R G B", vec![1, 2, 3, 40, 50, 60, 7, 8, 9]));
    let (names, values) = codes(&png_file([2, 1], 8, 3, false, &[palette, (b"tRNS", &[255, 128])], &[0, 1, 2]));
    assert_eq!((names.join(" ").as_str(), values), ("R G B A", vec![40, 50, 60, 128, 7, 8, 9, 255]));
    let (names, values) = codes(&png_file([2, 1], 8, 0, false, &[(b"tRNS", &[0, 7])], &[0, 7, 8]));
    assert_eq!((names.join(" ").as_str(), values), ("Y A", vec![7, 0, 8, 255]));
    let (names, _) = codes(&png_file([1, 1], 16, 2, false, &[(b"tRNS", &[0, 1, 0, 2, 0, 3])], &[0, 0, 1, 0, 2, 0, 3]));
    assert_eq!(names.join(" "), "R G B A");
    assert!(decode(&png_file([2, 1], 8, 3, false, &[palette], &[0, 1, 9]), &DecodeOptions::default()).is_ok_and(|p| p.width == 2));
}

#[test]
fn interlaced_png_is_read() {
    // Adam7 (section 8.1): the passes' first columns and rows and their steps.
    let passes = [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2)];
    let (w, h) = (11usize, 6usize);
    let value = |x: usize, y: usize| (y * w + x) as u8;
    let mut rows = Vec::new();
    for (x0, y0, dx, dy) in passes {
        for y in (y0..h).step_by(dy).filter(|_| x0 < w) {
            rows.push(0);
            rows.extend((x0..w).step_by(dx).map(|x| value(x, y)));
        }
    }
    let read = codes(&png_file([w as u32, h as u32], 8, 0, true, &[], &rows)).1;
    assert_eq!(read, (0..66).collect::<Vec<u8>>());
}

#[test]
fn png_curves_are_read_from_their_chunks() {
    let read = |chunks: &[(&[u8; 4], &[u8])]| decode(&png_file([1, 1], 8, 0, false, chunks, &[0, 128]), &DecodeOptions::default());
    let light = |chunks: &[(&[u8; 4], &[u8])]| read(chunks).unwrap().pixels[0];
    let (srgb, code) = (0.215_860_5, 128.0 / 255.0f64);
    let gamma = |value: u32| value.to_be_bytes();
    assert!((light(&[]) - srgb).abs() < 1e-6);
    assert!((light(&[(b"gAMA", &gamma(45_455))]) - srgb).abs() < 1e-6);
    assert!((f64::from(light(&[(b"gAMA", &gamma(100_000))])) - code).abs() < 1e-6);
    assert!((f64::from(light(&[(b"gAMA", &gamma(55_556))])) - code.powf(1.8)).abs() < 1e-5);
    assert!((light(&[(b"sRGB", &[0]), (b"gAMA", &gamma(100_000))]) - srgb).abs() < 1e-6);
    assert!((f64::from(light(&[(b"cICP", &[1, 8, 0, 1])])) - code).abs() < 1e-6);
    let error = read(&[(b"cICP", &[9, 16, 0, 1])]).unwrap_err().to_string();
    assert!(error.starts_with("png with transfer characteristics 16 (video or high dynamic range codes) is not supported"));
}

#[test]
fn headers_that_promise_too_much_are_refused_at_once() {
    let limit = DecodeOptions::default();
    let png = |w, h| png_file([w, h], 8, 6, false, &[], &[0]);
    let error = |bytes: &[u8]| decode(bytes, &limit).unwrap_err().to_string();
    let too_large =
        "expected at most 1073741824 samples in one png file, found 100000 x 100000 pixels of 4 channels; raise the limit if it is meant";
    assert_eq!(error(&png(100_000, 100_000)), too_large);
    assert_eq!(probe(Cursor::new(&png(100_000, 100_000)), &limit).unwrap_err().to_string(), too_large);
    assert!(error(&png(16_000, 16_000)).starts_with("expected a sound png file, found 6"));
    let mut exr = encode_to_vec(&picture(2, 2, 3), &EncodeOptions::new(Format::Exr)).unwrap();
    let at = exr.windows(11).position(|w| w == b"dataWindow\0").unwrap() + 11 + 6 + 4;
    exr[at + 8..at + 16].copy_from_slice(&[0xff, 0xff, 1, 0, 0xff, 0xff, 1, 0]);
    let found = error(&exr);
    assert!(
        found.starts_with("expected at most 1073741824 samples in one exr file, found 131072 x 131072 pixels")
            || found.starts_with("expected a sound exr"),
        "{found}"
    );
    let mut tiff = encode_to_vec(&picture(2, 2, 3), &EncodeOptions::new(Format::Tiff)).unwrap();
    tiff[8 + 2 + 8..8 + 2 + 12].copy_from_slice(&200_000u32.to_le_bytes());
    tiff[8 + 2 + 12 + 8..8 + 2 + 24].copy_from_slice(&200_000u32.to_le_bytes());
    assert!(!error(&tiff).is_empty());
}

/// A TIFF put together by hand: entries of shorts (the strip or tile offset is filled in), then the samples at the end.
fn tiff_file(big_endian: bool, entries: &[(u16, &[u16])], data: &[u8]) -> Vec<u8> {
    let short = |v: u16| if big_endian { v.to_be_bytes() } else { v.to_le_bytes() };
    let long = |v: u32| if big_endian { v.to_be_bytes() } else { v.to_le_bytes() };
    let table_end = 8 + 2 + 12 * entries.len() + 4;
    let data_at = table_end + entries.iter().filter(|e| e.1.len() > 2).map(|e| 2 * e.1.len()).sum::<usize>();
    let mut bytes = if big_endian { b"MM\0\x2a".to_vec() } else { b"II\x2a\0".to_vec() };
    bytes.extend(long(8));
    bytes.extend(short(entries.len() as u16));
    let mut outside = Vec::new();
    for (tag, values) in entries {
        bytes.extend([short(*tag), short(3)].concat());
        bytes.extend(long(values.len() as u32));
        // Offsets of strips and tiles: the n-th piece is n times the first value behind the start.
        let values: Vec<u16> = match tag {
            273 | 324 => values.iter().map(|v| v + data_at as u16).collect(),
            _ => values.to_vec(),
        };
        if values.len() > 2 {
            bytes.extend(long((table_end + outside.len()) as u32));
            outside.extend(values.iter().flat_map(|v| short(*v)));
        } else {
            bytes.extend(values.iter().chain(&[0, 0]).take(2).flat_map(|v| short(*v)));
        }
    }
    bytes.extend([0; 4]);
    bytes.extend(outside);
    bytes.extend(data);
    bytes
}

#[test]
fn tiff_of_other_byte_orders_bits_planes_and_tiles_is_read() {
    let grey16: [(u16, &[u16]); 9] =
        [(256, &[2]), (257, &[1]), (258, &[16]), (259, &[1]), (262, &[1]), (273, &[0]), (277, &[1]), (278, &[1]), (279, &[4])];
    let big = decode(&tiff_file(true, &grey16, &[0x12, 0x34, 0xff, 0xff]), &DecodeOptions { color: ColorMode::Data, ..Default::default() })
        .unwrap();
    assert_eq!(big.pixels, [(0x1234 as f64 / 65535.0) as f32, 1.0]);
    let bits: [(u16, &[u16]); 9] =
        [(256, &[10]), (257, &[1]), (258, &[1]), (259, &[1]), (262, &[0]), (273, &[0]), (277, &[1]), (278, &[1]), (279, &[2])];
    assert_eq!(codes(&tiff_file(false, &bits, &[0b1010_0000, 0b1000_0000])).1, [0, 255, 0, 255, 255, 255, 255, 255, 0, 255]);
    let planar: [(u16, &[u16]); 10] = [
        (256, &[2]),
        (257, &[1]),
        (258, &[8, 8, 8]),
        (259, &[1]),
        (262, &[2]),
        (273, &[0, 2, 4]),
        (277, &[3]),
        (278, &[1]),
        (279, &[2, 2, 2]),
        (284, &[2]),
    ];
    assert_eq!(codes(&tiff_file(false, &planar, &[1, 2, 3, 4, 5, 6])).1, [1, 3, 5, 2, 4, 6]);
    let mut tile = vec![0u8; 2 * 256];
    (0..20).for_each(|x| tile[x / 16 * 256 + x % 16] = x as u8);
    let tiled: [(u16, &[u16]); 10] = [
        (256, &[20]),
        (257, &[1]),
        (258, &[8]),
        (259, &[1]),
        (262, &[1]),
        (277, &[1]),
        (322, &[16]),
        (323, &[16]),
        (324, &[0, 256]),
        (325, &[256, 256]),
    ];
    assert_eq!(codes(&tiff_file(true, &tiled, &tile)).1, (0..20).collect::<Vec<u8>>());
}

#[test]
fn tiff_alpha_is_read_as_it_is_declared() {
    let read = |extra: u16| {
        let entries: [(u16, &[u16]); 10] = [
            (256, &[1]),
            (257, &[1]),
            (258, &[8, 8, 8, 8]),
            (259, &[1]),
            (262, &[2]),
            (273, &[0]),
            (277, &[4]),
            (278, &[1]),
            (279, &[4]),
            (338, &[extra]),
        ];
        decode(&tiff_file(false, &entries, &[64, 32, 0, 128]), &DecodeOptions::default()).unwrap()
    };
    let light = |code: f64| curve::linear_from_srgb(code / 255.0);
    let alpha = 128.0 / 255.0;
    let straight = read(2);
    assert!((f64::from(straight.pixels[0]) - light(64.0) * alpha).abs() < 1e-6);
    // Codes that were multiplied are divided as codes before the curve is undone.
    let associated = read(1);
    assert!((f64::from(associated.pixels[0]) - light(64.0 / alpha) * alpha).abs() < 1e-6);
    assert_eq!(associated.notes, [""; 0]);
    assert_eq!(read(0).channels.join(" "), "R G B");
    assert_eq!(read(0).notes, ["channels that are not declared as alpha are left out"]);
}

#[test]
fn tiff_of_other_colours_is_refused_by_name() {
    let error = |photometric: u16, bits: u16, format: u16| {
        let (samples, counts) = (vec![bits; 4], [4 * bits / 8]);
        let entries: [(u16, &[u16]); 10] = [
            (256, &[1]),
            (257, &[1]),
            (258, &samples),
            (259, &[1]),
            (262, &[photometric]),
            (273, &[0]),
            (277, &[4]),
            (278, &[1]),
            (279, &counts),
            (339, &[format; 4]),
        ];
        decode(&tiff_file(false, &entries, &[0; 32]), &DecodeOptions::default()).unwrap_err().to_string()
    };
    let hint = "save it as grey or rgb of 8 or 16 bits or floats of 16 or 32 bits";
    assert_eq!(error(5, 8, 1), format!("tiff with CMYK(8) colours is not supported; {hint}"));
    assert_eq!(error(2, 16, 2), format!("tiff with signed integers of 16 bits is not supported; {hint}"));
    assert_eq!(error(2, 32, 1), format!("tiff with integers of 32 bits is not supported; {hint}"));
}
