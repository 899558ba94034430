//! An even exposure over a whole shot.

use pegbar_plugin::prelude::*;
use pegbar_plugin::types::Image;

/// Measures the exposure of each frame against the mean of the whole shot, as drawings that were shot one by one under a lamp flicker.
#[derive(Node)]
#[node(id = "paper.exposure", version = 1, kind = whole, outputs = PaperExposureOutputs, example = r#""even": (type: "paper.exposure", image: "@plate", smooth: 0.5)"#)]
pub(crate) struct PaperExposure {
    /// The shot.
    image: Sequence<Image>,
    /// How much of the flicker is taken away; 0 leaves the shot as it is, 1 gives each frame the same mean.
    #[input(default = 1.0, range = 0.0..=1.0)]
    smooth: f64,
}

/// What it makes.
#[derive(Outputs)]
pub(crate) struct PaperExposureOutputs {
    /// Each frame with the mean of the shot.
    image: Stream<Image>,
    /// What was measured.
    exposure: Exposure,
}

/// The exposure of a shot.
#[derive(Clone, Debug, Value)]
pub(crate) struct Exposure {
    /// Mean light of each frame.
    #[value(shape = "[t]")]
    means: Vec<f64>,
    /// Factor that each frame was multiplied by.
    #[value(shape = "[t]")]
    gains: Vec<f64>,
    /// What the shot is levelled to, for people.
    #[value(text)]
    level: String,
}

fn mean(image: &Image) -> f64 {
    let (alpha, channels) = (image.alpha(), image.size()[2].max(1));
    let light = image.pixels.iter().enumerate().filter(|(i, _)| Some(i % channels) != alpha).map(|(_, &s)| f64::from(s));
    let (sum, count) = light.fold((0.0, 0u64), |(sum, n), s| (sum + s, n + 1));
    if count == 0 { 0.0 } else { sum / count as f64 }
}

impl Whole for PaperExposure {
    fn run(self, cx: &Context) -> Result<PaperExposureOutputs, NodeError> {
        if self.image.is_empty() {
            return Err(NodeError::input("expected pictures to measure, found none"));
        }
        let means = (0..self.image.len()).map(|i| cx.check().and_then(|()| self.image.get(i)).map(|image| mean(&image)));
        let means = means.collect::<Result<Vec<f64>, _>>()?;
        let level = means.iter().sum::<f64>() / means.len().max(1) as f64;
        let gains: Vec<f64> = means.iter().map(|&m| if m > 0.0 { 1.0 + (level / m - 1.0) * self.smooth } else { 1.0 }).collect();
        let (mut frames, mut last) = (Vec::with_capacity(gains.len()), None);
        for i in 0..cx.clock.len() {
            // A single picture stands at every frame.
            let at = if self.image.clock().is_some() { i } else { 0 };
            if last.as_ref().is_none_or(|(n, _)| *n != at) {
                last = Some((at, self.image.get(at)?));
            }
            let (Some((_, image)), Some(&gain)) = (&last, gains.get(at)) else { continue };
            let (alpha, channels, mut c) = (image.alpha(), image.size()[2].max(1), 0);
            frames.push(image.map(|sample| {
                let is_alpha = Some(c % channels) == alpha;
                c += 1;
                if is_alpha { sample } else { sample * gain as f32 }
            })?);
        }
        Ok(PaperExposureOutputs { image: Stream(frames), exposure: Exposure { means, gains, level: format!("{level:.4}") } })
    }
}
