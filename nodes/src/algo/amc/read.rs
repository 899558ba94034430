//! Acclaim text as bones and numbers.

use std::collections::BTreeMap;

use nalgebra::UnitQuaternion;

use super::{Amc, Asf, Bone, Dof, product};
use crate::algo::bvh::MAX_JOINTS;
use crate::algo::text::{TextError, Word, Words};

/// The lines of a text as words, without comments.
struct Lines<'a> {
    words: Words<'a>,
    ahead: Option<Vec<Word<'a>>>,
}

impl<'a> Lines<'a> {
    fn new(text: &'a str) -> Self {
        Self { words: Words::new(text, &[]), ahead: None }
    }

    /// The next line that says something; one empty word at the end of the text.
    fn next(&mut self) -> Vec<Word<'a>> {
        self.ahead.take().unwrap_or_else(|| {
            loop {
                let line = self.words.line();
                if line.is_end() {
                    return vec![line];
                }
                let words: Vec<Word<'a>> = line.split().take_while(|w| !w.text.starts_with('#')).collect();
                if !words.is_empty() {
                    return words;
                }
            }
        })
    }

    fn error(&self, word: Word, expected: impl Into<String>) -> TextError {
        self.words.error(word, expected)
    }

    /// Numbers from the words of a line after the first.
    fn numbers<const N: usize>(&self, line: &[Word<'a>]) -> Result<[f64; N], TextError> {
        let mut found = [0.0; N];
        for (k, value) in found.iter_mut().enumerate() {
            *value = match line.get(k + 1) {
                Some(word) => self.words.parsed(*word)?,
                None => return Err(self.words.error_at(line[0], format!("{N} numbers after `{}`", line[0].text), k.to_string())),
            };
        }
        Ok(found)
    }
}

/// A bone as it is read: angles in the file's unit.
struct Raw {
    bone: Bone,
    angles: [f64; 3],
}

fn raw(order: [usize; 3]) -> Raw {
    let axes = UnitQuaternion::identity();
    Raw { bone: Bone { name: String::new(), parent: None, vector: [0.0; 3], axes, order, dofs: Vec::new() }, angles: [0.0; 3] }
}

/// Axes as `XYZ`, each once.
fn axis_order(lines: &Lines, word: Word) -> Result<[usize; 3], TextError> {
    let axes: Vec<usize> = word.text.chars().filter_map(|c| "XYZ".find(c.to_ascii_uppercase())).collect();
    match axes[..] {
        [a, b, c] if word.text.len() == 3 && a != b && b != c && a != c => Ok([a, b, c]),
        _ => Err(lines.error(word, "an order of axes as XYZ")),
    }
}

fn dof(lines: &Lines, word: Word, is_root: bool) -> Result<Dof, TextError> {
    let axis = |kind: &str| ["x", "y", "z"].iter().position(|a| word.is(&format!("{kind}{a}")));
    let translation = if is_root { axis("t").map(Dof::Translation) } else { None };
    let expected = if is_root { "TX, TY, TZ, RX, RY or RZ, each once" } else { "rx, ry or rz, each once" };
    axis("r").map(Dof::Rotation).or(translation).ok_or_else(|| lines.error(word, expected))
}

fn dofs(lines: &Lines, line: &[Word], is_root: bool) -> Result<Vec<Dof>, TextError> {
    let mut found = Vec::new();
    for word in &line[1..] {
        let own = dof(lines, *word, is_root)?;
        if found.contains(&own) {
            return Err(lines.error(*word, "each degree of freedom once"));
        }
        found.push(own);
    }
    Ok(found)
}

/// Reads a skeleton. O(characters).
///
/// # Errors
/// Where the text is no ASF, or its bones make no tree: line, column, and what was expected.
pub fn read_asf(text: &str) -> Result<Asf, TextError> {
    let mut lines = Lines::new(text);
    let (mut length, mut is_radians) = (1.0, false);
    let mut root = None;
    let mut bones: Vec<Raw> = Vec::new();
    let mut parents: BTreeMap<String, String> = BTreeMap::new();
    let end = loop {
        let line = lines.next();
        let head = line[0];
        if head.is_end() {
            break head;
        }
        if head.is(":units") {
            (length, is_radians) = units(&mut lines)?;
        } else if head.is(":root") {
            root = Some(self::root(&mut lines)?);
        } else if head.is(":bonedata") {
            bones = bonedata(&mut lines)?;
        } else if head.is(":hierarchy") {
            parents = hierarchy(&mut lines, &bones)?;
        } else if head.text.starts_with(':') {
            section(&mut lines, |_, _| Ok(()))?;
        } else {
            return Err(lines.error(head, "a section as :units, :root, :bonedata or :hierarchy"));
        }
    };
    let root = root.ok_or_else(|| lines.error(end, ":root"))?;
    let bones = tree(root, bones, &parents).ok_or_else(|| lines.error(end, ":hierarchy with a parent for each bone"))?;
    let to_degrees = |a: f64| if is_radians { a.to_degrees() } else { a };
    let axes = |r: Raw| Bone { axes: product(r.bone.order, r.angles.map(to_degrees)), ..r.bone };
    Ok(Asf { bones: bones.into_iter().map(axes).collect(), length, is_radians })
}

/// Gives each line up to the next section to `each`.
fn section<'a>(lines: &mut Lines<'a>, mut each: impl FnMut(&Lines<'a>, &[Word<'a>]) -> Result<(), TextError>) -> Result<(), TextError> {
    loop {
        let line = lines.next();
        if line[0].is_end() || line[0].text.starts_with(':') {
            lines.ahead = Some(line);
            return Ok(());
        }
        each(lines, &line)?;
    }
}

fn units(lines: &mut Lines) -> Result<(f64, bool), TextError> {
    let (mut length, mut is_radians) = (1.0, false);
    section(lines, |lines, line| {
        if line[0].is("length") {
            [length] = lines.numbers(line)?;
            if length <= 1e-9 {
                return Err(lines.error(line[1], "a length above 0"));
            }
        } else if line[0].is("angle") {
            let word = line.get(1).copied().unwrap_or(line[0]);
            is_radians = word.is("rad");
            if !is_radians && !word.is("deg") {
                return Err(lines.error(word, "deg or rad"));
            }
        }
        Ok(())
    })?;
    Ok((length, is_radians))
}

fn root(lines: &mut Lines) -> Result<Raw, TextError> {
    let mut root = raw([0, 1, 2]);
    root.bone.name = "root".to_owned();
    section(lines, |lines, line| {
        if line[0].is("order") {
            root.bone.dofs = dofs(lines, line, true)?;
        } else if line[0].is("axis") {
            root.bone.order = axis_order(lines, line.get(1).copied().unwrap_or(line[0]))?;
        } else if line[0].is("position") {
            root.bone.vector = lines.numbers(line)?;
        } else if line[0].is("orientation") {
            root.angles = lines.numbers(line)?;
        } else {
            return Err(lines.error(line[0], "order, axis, position or orientation"));
        }
        Ok(())
    })?;
    Ok(root)
}

fn bonedata(lines: &mut Lines) -> Result<Vec<Raw>, TextError> {
    let mut bones: BTreeMap<String, usize> = BTreeMap::new();
    let (mut found, mut open): (Vec<Raw>, Option<(Raw, f64)>) = (Vec::new(), None);
    section(lines, |lines, line| {
        let head = line[0];
        let Some((own, length)) = &mut open else {
            if !head.is("begin") {
                return Err(lines.error(head, "begin"));
            }
            open = Some((raw([0, 1, 2]), 0.0));
            return Ok(());
        };
        if head.is("end") {
            let name = own.bone.name.clone();
            if name.is_empty() || name == "root" || bones.insert(name, found.len()).is_some() {
                return Err(lines.error_at(head, "a name of the bone, unlike every other", &own.bone.name));
            }
            if found.len() >= MAX_JOINTS / 2 {
                return Err(lines.error_at(head, &format!("at most {} bones", MAX_JOINTS / 2), "more"));
            }
            own.bone.vector = own.bone.vector.map(|v| v * *length);
            found.extend(open.take().map(|(own, _)| own));
        } else if head.is("name") {
            own.bone.name = line.get(1).map(|w| w.text.to_owned()).unwrap_or_default();
        } else if head.is("direction") {
            own.bone.vector = lines.numbers(line)?;
        } else if head.is("length") {
            [*length] = lines.numbers(line)?;
        } else if head.is("axis") {
            own.angles = lines.numbers(line)?;
            own.bone.order = line.get(4).map_or(Ok([0, 1, 2]), |word| axis_order(lines, *word))?;
        } else if head.is("dof") {
            own.bone.dofs = dofs(lines, line, false)?;
        } else if !["id", "limits", "bodymass", "cofmass"].iter().any(|w| head.is(w)) && !head.text.starts_with('(') {
            return Err(lines.error(head, "name, direction, length, axis, dof, limits or end"));
        }
        Ok(())
    })?;
    let next = lines.next();
    if open.is_some() {
        return Err(lines.error(next[0], "end"));
    }
    lines.ahead = Some(next);
    Ok(found)
}

/// The parent of each bone that has one.
fn hierarchy(lines: &mut Lines, bones: &[Raw]) -> Result<BTreeMap<String, String>, TextError> {
    let known: std::collections::BTreeSet<&str> = bones.iter().map(|b| b.bone.name.as_str()).collect();
    let mut parents = BTreeMap::new();
    section(lines, |lines, line| {
        if line.len() == 1 && (line[0].is("begin") || line[0].is("end")) {
            return Ok(());
        }
        if line[0].text != "root" && !known.contains(line[0].text) {
            return Err(lines.error(line[0], "root or a bone of :bonedata"));
        }
        for child in &line[1..] {
            if !known.contains(child.text) || parents.insert(child.text.to_owned(), line[0].text.to_owned()).is_some() {
                return Err(lines.error(*child, "a bone of :bonedata, each once"));
            }
        }
        Ok(())
    })?;
    Ok(parents)
}

/// The root and the bones, parents first; `None` where a bone hangs on nothing that hangs on the root.
fn tree(root: Raw, bones: Vec<Raw>, parents: &BTreeMap<String, String>) -> Option<Vec<Raw>> {
    let mut children: BTreeMap<&str, Vec<Raw>> = BTreeMap::new();
    let n = bones.len();
    for bone in bones {
        children.entry(parents.get(&bone.bone.name)?.as_str()).or_default().push(bone);
    }
    let mut found = vec![root];
    let mut next = 0;
    while next < found.len() {
        for mut bone in children.remove(found[next].bone.name.as_str()).unwrap_or_default() {
            bone.bone.parent = Some(next);
            found.push(bone);
        }
        next += 1;
    }
    (found.len() == n + 1).then_some(found)
}

/// Reads the motion of a skeleton. O(characters).
///
/// # Errors
/// Where the text is no AMC, a bone is unknown, or a frame has other bones or numbers than the skeleton moves: line, column, and what was expected.
pub fn read_amc(text: &str, asf: &Asf) -> Result<Amc, TextError> {
    let mut lines = Lines::new(text);
    let mut starts = BTreeMap::new();
    let mut width = 0;
    for (b, bone) in asf.bones.iter().enumerate() {
        starts.insert(bone.name.as_str(), (b, width));
        width += bone.dofs.len();
    }
    let moving = asf.bones.iter().filter(|b| !b.dofs.is_empty()).count();
    let mut motion = Amc { n_frames: 0, values: Vec::new() };
    let mut is_radians = asf.is_radians;
    let mut told = std::collections::BTreeSet::new();
    loop {
        let line = lines.next();
        let head = line[0];
        let begins = head.text.parse::<u64>().is_ok() && line.len() == 1;
        if (begins || head.is_end()) && motion.n_frames > 0 && told.len() < moving {
            let missing = asf.bones.iter().find(|b| !b.dofs.is_empty() && !told.contains(b.name.as_str())).map_or("", |b| &b.name);
            return Err(lines.error(head, format!("`{missing}` in the frame before it")));
        }
        if head.is_end() {
            break;
        }
        if head.text.starts_with(':') {
            is_radians = if head.is(":radians") { true } else { is_radians && !head.is(":degrees") };
        } else if begins {
            motion.n_frames += 1;
            told.clear();
            // A frame that lacks a bone is refused before the next begins, so that memory goes with the text.
            motion.values.resize(motion.n_frames.saturating_mul(width), 0.0);
        } else if motion.n_frames == 0 {
            return Err(lines.error(head, "the number of a frame"));
        } else {
            let Some(&(b, start)) = starts.get(head.text) else {
                return Err(lines.error(head, "a bone of the skeleton, or the number of a frame"));
            };
            let bone = &asf.bones[b];
            if line.len() != bone.dofs.len() + 1 || !told.insert(head.text) && !bone.dofs.is_empty() {
                let expected = format!("{} numbers of `{}`, once a frame", bone.dofs.len(), bone.name);
                return Err(lines.words.error_at(head, expected, (line.len() - 1).to_string()));
            }
            for (k, (word, dof)) in line[1..].iter().zip(&bone.dofs).enumerate() {
                let value = lines.words.parsed(*word)?;
                let is_angle = matches!(dof, Dof::Rotation(_));
                let at = (motion.n_frames - 1) * width + start + k;
                motion.values[at] = if is_radians && is_angle { value.to_degrees() } else { value };
            }
        }
    }
    if motion.n_frames == 0 {
        let end = lines.next();
        return Err(lines.error(end[0], "at least one frame"));
    }
    Ok(motion)
}

impl Lines<'_> {
    fn error_at(&self, word: Word, expected: &str, found: &str) -> TextError {
        self.words.error_at(word, expected, format!("`{found}`"))
    }
}
