//! BVH text as joints and numbers.

use std::collections::BTreeMap;

use super::{Bvh, BvhJoint, Channel, MAX_JOINTS};
use crate::algo::take::rate;
use crate::algo::text::{TextError, Word, Words};

/// The most channels of a joint: three positions, and rotations to spare.
const MAX_CHANNELS: usize = 12;

/// Reads a file. O(characters), in memory too, whatever it declares.
///
/// # Errors
/// Where the text is no BVH, a number is none, or there are fewer or more frames than it declares: line, column, and what was expected.
pub fn read(text: &str) -> Result<Bvh, TextError> {
    let mut reader = Reader { words: Words::new(text, &['{', '}']), joints: Vec::new(), renamed: Vec::new(), taken: BTreeMap::new() };
    reader.hierarchy()?;
    reader.motion()
}

struct Reader<'a> {
    words: Words<'a>,
    joints: Vec<BvhJoint>,
    renamed: Vec<(String, String)>,
    /// Names that are taken, and the number that the next of each may have.
    taken: BTreeMap<String, usize>,
}

/// A joint whose braces are open.
struct Open {
    joint: usize,
    has_offset: bool,
    has_channels: bool,
}

impl<'a> Reader<'a> {
    fn hierarchy(&mut self) -> Result<(), TextError> {
        let start = self.words.next_word();
        if !start.is("HIERARCHY") {
            return Err(self.words.error(start, "HIERARCHY"));
        }
        let mut open: Vec<Open> = Vec::new();
        loop {
            let word = self.words.next_word();
            let Some(top) = open.last_mut() else {
                if word.is("MOTION") && !self.joints.is_empty() {
                    return Ok(());
                }
                if !word.is("ROOT") {
                    return Err(self.words.error(word, if self.joints.is_empty() { "ROOT" } else { "MOTION or ROOT" }));
                }
                open.push(self.begin(word, None)?);
                continue;
            };
            let (joint, is_end) = (top.joint, self.joints[top.joint].is_end);
            if word.text == "}" {
                if !top.has_offset {
                    return Err(self.words.error(word, format!("OFFSET in `{}`", self.joints[joint].name)));
                }
                open.pop();
            } else if word.is("OFFSET") && !top.has_offset {
                top.has_offset = true;
                self.joints[joint].offset = [self.words.number()?, self.words.number()?, self.words.number()?];
            } else if word.is("CHANNELS") && !top.has_channels && !is_end {
                top.has_channels = true;
                self.joints[joint].channels = self.channels()?;
            } else if (word.is("JOINT") || word.is("End")) && !is_end {
                open.push(self.begin(word, Some(joint))?);
            } else {
                let (offset, channels) = (!top.has_offset, !top.has_channels && !is_end);
                let words = [(offset, "OFFSET"), (channels, "CHANNELS"), (!is_end, "JOINT"), (!is_end, "End Site"), (true, "}")];
                let wanted: Vec<&str> = words.into_iter().filter(|w| w.0).map(|w| w.1).collect();
                return Err(self.words.error(word, wanted.join(", ")));
            }
        }
    }

    /// A joint from its name to its opening brace.
    fn begin(&mut self, word: Word<'a>, parent: Option<usize>) -> Result<Open, TextError> {
        if self.joints.len() >= MAX_JOINTS {
            return Err(self.words.error_at(word, format!("at most {MAX_JOINTS} joints"), "more"));
        }
        let is_end = word.is("End");
        let name = self.words.rest_of_line();
        let name = match parent.map(|p| &self.joints[p].name) {
            Some(parent) if is_end => format!("{parent}_end"),
            _ if name.is_end() => return Err(self.words.error(name, "a name")),
            _ => name.text.to_owned(),
        };
        let brace = self.words.next_word();
        if brace.text != "{" {
            return Err(self.words.error(brace, format!("{{ after `{name}`")));
        }
        let name = self.unique(name);
        self.joints.push(BvhJoint { name, parent, offset: [0.0; 3], channels: Vec::new(), is_end });
        Ok(Open { joint: self.joints.len() - 1, has_offset: false, has_channels: false })
    }

    /// The name, with a number after it where it is taken.
    fn unique(&mut self, name: String) -> String {
        let mut free = name.clone();
        // Each name goes on from the number where it was left, so that many of one name do not all start from 2.
        let mut n = self.taken.get(&name).copied().unwrap_or(2);
        while self.taken.contains_key(&free) {
            free = format!("{name}_{n}");
            n += 1;
        }
        if free != name {
            self.taken.insert(name.clone(), n);
        }
        if free != name {
            self.renamed.push((name, free.clone()));
        }
        self.taken.entry(free.clone()).or_insert(2);
        free
    }

    fn channels(&mut self) -> Result<Vec<Channel>, TextError> {
        let word = self.words.next_word();
        let count: usize = word.text.parse().ok().filter(|n| *n <= MAX_CHANNELS).ok_or_else(|| {
            let expected = format!("a number of channels from 0 to {MAX_CHANNELS}");
            self.words.error(word, expected)
        })?;
        let mut channels = Vec::new();
        for _ in 0..count {
            let word = self.words.next_word();
            let axis = |kind: &str| ["X", "Y", "Z"].iter().position(|a| word.is(&format!("{a}{kind}")));
            let position = axis("position").map(Channel::Position).filter(|c| !channels.contains(c));
            match position.or(axis("rotation").map(Channel::Rotation)) {
                Some(channel) => channels.push(channel),
                None => {
                    let expected = "Xposition, Yposition, Zposition (each once), Xrotation, Yrotation or Zrotation";
                    return Err(self.words.error(word, expected));
                }
            }
        }
        Ok(channels)
    }

    /// What follows a label such as `Frames:` in its line; the colon may be missing.
    fn labelled(&mut self, label: &[&str]) -> Result<Word<'a>, TextError> {
        let line = self.words.line();
        let mut rest = line.text;
        for part in label {
            let trimmed = rest.trim_start();
            let head = trimmed.get(..part.len()).filter(|head| head.eq_ignore_ascii_case(part));
            let head = head.ok_or_else(|| self.words.error(line, format!("{}:", label.join(" "))))?;
            rest = trimmed.get(head.len()..).unwrap_or_default();
        }
        let value = rest.trim_start();
        Ok(line.end(value.strip_prefix(':').unwrap_or(value).trim_start().len()))
    }

    fn motion(mut self) -> Result<Bvh, TextError> {
        let word = self.labelled(&["Frames"])?;
        let parsed = word.text.parse().ok().filter(|n: &usize| *n > 0);
        let n_frames: usize = parsed.ok_or_else(|| self.words.error(word, "a number of frames above 0"))?;
        let word = self.labelled(&["Frame", "Time"])?;
        let frame_time = self.words.parsed(word).ok().filter(|t| *t > 1e-9 && *t < 1e9);
        let frame_time = frame_time.ok_or_else(|| self.words.error(word, "the seconds of a frame, above 0"))?;
        let digits = match word.text.split_once(['e', 'E']) {
            Some(_) => 300,
            None => word.text.split_once('.').map_or(0, |(_, digits)| digits.len()),
        };
        let width = self.joints.iter().map(|j| j.channels.len()).sum();
        let values = self.rows(n_frames, width)?;
        let fps = rate(frame_time, digits);
        Ok(Bvh { joints: self.joints, renamed: self.renamed, n_frames, frame_time, fps, values })
    }

    /// The numbers of all frames; lines may end anywhere.
    fn rows(&mut self, n_frames: usize, width: usize) -> Result<Vec<f64>, TextError> {
        let mut values = Vec::new();
        // The first line that has another number of numbers than a frame: what is missing is missing there, if lines are frames at all.
        let (mut odd, mut line, mut on_line) = (None, None, 0);
        let mut first_of_line = self.words.peek();
        let end = loop {
            let word = self.words.next_word();
            if line.is_some_and(|l| l != word.line) || word.is_end() {
                if on_line != width && odd.is_none() && on_line > 0 {
                    odd = Some((first_of_line, on_line));
                }
                (on_line, first_of_line) = (0, word);
            }
            if word.is_end() {
                break word;
            }
            values.push(self.words.parsed(word)?);
            (line, on_line) = (Some(word.line), on_line + 1);
        };
        if n_frames.checked_mul(width) == Some(values.len()) {
            return Ok(values);
        }
        if let (Some((at, found)), true) = (odd, values.len() / width.max(1) + 1 >= n_frames) {
            return Err(self.words.error_at(at, format!("{width} numbers, those of a frame"), found.to_string()));
        }
        let found = format!("{} numbers, which are {} frames", values.len(), values.len() / width.max(1));
        Err(self.words.error_at(end, format!("{n_frames} frames of {width} numbers"), found))
    }
}
