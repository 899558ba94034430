//! What can go wrong with a picture file.

/// Why a picture could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum CodecError {
    /// The first bytes are of no format that is read here.
    #[error("expected a png, jpeg, tiff or exr file, found {found}")]
    UnknownFormat {
        /// What the bytes look like.
        found: String,
    },
    /// The file is damaged, cut short or contradicts itself.
    #[error("expected a sound {format} file, found {what}; it may have been cut short or damaged: copy or render it again")]
    Corrupt {
        /// The format that the file claims.
        format: &'static str,
        /// What was found.
        what: String,
    },
    /// The file is well formed, but holds something that is not read here.
    #[error("{format} with {what} is not supported; {hint}")]
    Unsupported {
        /// The format.
        format: &'static str,
        /// The feature.
        what: String,
        /// What to do instead.
        hint: String,
    },
    /// The header asks for more samples than permitted.
    #[error(
        "expected at most {limit} samples in one {format} file, found {width} x {height} pixels of {channels} channels; raise the limit if it is meant"
    )]
    TooLarge {
        /// The format.
        format: &'static str,
        /// Columns.
        width: u64,
        /// Rows.
        height: u64,
        /// Samples a pixel.
        channels: u64,
        /// The limit in samples.
        limit: u64,
    },
    /// The layer asked for is not in the file.
    #[error("expected {layers}, found the layer `{name}`{suggestion}")]
    NoLayer {
        /// What was asked for.
        name: String,
        /// What there is: "one of the layers a, b" or "no layer: the file has but one".
        layers: String,
        /// Empty, or "; did you mean `x`?".
        suggestion: String,
    },
    /// The format cannot hold what was asked for.
    #[error("{format} cannot hold {found}; it takes {choices}")]
    Combination {
        /// The format.
        format: &'static str,
        /// What was asked for.
        found: String,
        /// What can be had.
        choices: String,
    },
    /// The picture to be written contradicts itself.
    #[error("expected a picture with {what}")]
    BadPicture {
        /// What was expected and found.
        what: String,
    },
    /// A sample is NaN or infinite, and the options refuse such.
    #[error("expected finite samples, found {value} in channel {channel} at column {x}, row {y}; integers cannot hold it")]
    NotFinite {
        /// The sample.
        value: f32,
        /// Its channel.
        channel: String,
        /// Its column in the data window, from 0.
        x: usize,
        /// Its row in the data window, from 0.
        y: usize,
    },
    /// The reader or writer failed.
    #[error("reading or writing failed: {0}")]
    Io(#[from] std::io::Error),
}

/// What the first bytes of a file look like, for a message.
pub(super) fn describe_prefix(prefix: &[u8]) -> String {
    let known: [(&[u8], &str); 11] = [
        (b"GIF8", "a gif file: convert its frames to png"),
        (b"RIFF", "a webp or other riff file: convert it to png"),
        (b"8BPS", "a photoshop file: save it as tiff or exr"),
        (b"BM", "a bmp file: convert it to png"),
        (b"SDPX", "a dpx file: convert it to exr"),
        (b"XPDS", "a dpx file: convert it to exr"),
        (b"#?RADIANCE", "a radiance hdr file: convert it to exr"),
        (b"PF", "a pfm file: convert it to exr"),
        (b"<", "text: rasterise vector drawings first"),
        (b"%PDF", "a pdf file: rasterise it first"),
        (b"version https://git-lfs", "a git-lfs pointer: fetch the file itself"),
    ];
    if prefix.is_empty() {
        return "an empty file".into();
    }
    if let Some((_, name)) = known.iter().find(|(magic, _)| prefix.starts_with(&magic[..magic.len().min(16)])) {
        return (*name).into();
    }
    let hex: Vec<_> = prefix.iter().take(8).map(|byte| format!("{byte:02x}")).collect();
    format!("a file that starts with the bytes {}", hex.join(" "))
}

/// The error for a layer `name` that is none of `names`.
pub(super) fn no_layer(name: &str, names: &[String]) -> CodecError {
    let layers =
        if names.is_empty() { "no layer: the file has but one".to_string() } else { format!("one of the layers {}", names.join(", ")) };
    CodecError::NoLayer { name: name.to_string(), layers, suggestion: did_you_mean(name, names) }
}

/// "; did you mean `x`?" for the nearest of `names` where it is near enough, else nothing.
fn did_you_mean(found: &str, names: &[String]) -> String {
    let nearest = names.iter().map(|name| (edit_distance(found, name), name)).min();
    match nearest {
        Some((distance, name)) if distance <= 1 + found.chars().count() / 4 => format!("; did you mean `{name}`?"),
        _ => String::new(),
    }
}

/// The Levenshtein distance without regard to case (Wagner and Fischer 1974): O(|a| |b|).
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.to_lowercase().chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.to_lowercase().chars().enumerate() {
        let mut diagonal = std::mem::replace(&mut row[0], i + 1);
        for (j, cb) in b.iter().enumerate() {
            let substituted = diagonal + usize::from(ca != *cb);
            diagonal = row[j + 1];
            row[j + 1] = substituted.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

/// A layer was asked of a format that has none.
pub(super) fn no_layers(format: &'static str, options: &super::DecodeOptions) -> CodecError {
    CodecError::Unsupported {
        format,
        what: format!("a layer `{}`", options.layer.as_deref().unwrap_or_default()),
        hint: "only exr files have layers: leave the layer out".into(),
    }
}
