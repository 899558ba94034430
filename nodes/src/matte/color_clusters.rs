//! `matte.color_clusters`: a soft matte of a layer from its colours.
//!
//! **Method** see [`crate::algo::color_clusters`]: a Gaussian mixture each for layer and ground, alpha the probability of the layer, ink given to what it
//! outlines, edges solved for their coverage.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande, *Turning to the Masters: Motion Capturing Cartoons*, 2002, section 3.3 (adaptive alpha matte).
//!
//! **Fails when** layer and ground share a colour over more than a few pixels.
//!
//! **Cost** O(pixels × clusters) a frame. With `adapt: 0` frames run in parallel once the first is learnt; with more they run in order.
//!
//! ```ron
//! "matte": (type: "matte.color_clusters", image: "@plate", foreground: [(0.10, 0.20, 0.80)]),
//! ```

use pegbar_engine::node::{Context, Frames, In, NodeError, Problem, Recurrent};
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs, Value};

use crate::algo::color_clusters::{self as algo, Gaussian, MatteError, Mix, Model, Options, Seed, Space};
use crate::data::{Image, Matte};

/// A soft matte of a layer from its colours.
///
/// Layer and ground are a mixture of Gaussian colour clusters each; alpha is the probability of the layer. Say what the layer is by its flat colours
/// (`foreground`) or by a rough matte of the first frame (`hint`).
#[derive(Node)]
#[node(
    id = "matte.color_clusters",
    version = 2,
    kind = recurrent,
    outputs = MatteColorClustersOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 3.3; eq. 16",
    example = "\"matte\": (type: \"matte.color_clusters\", image: \"@plate\", foreground: [(0.10, 0.20, 0.80)])"
)]
pub(crate) struct MatteColorClusters {
    /// The footage. Linear RGB; pictures with an alpha are taken as they lie on black.
    image: In<Image>,
    /// Colours of the layer as they are seen on screen, sRGB values 0 to 1, one for each flat colour: `[(0.10, 0.20, 0.80)]`. Needed without a `hint`.
    #[input(default = [], range = 0.0..=1.0, unit = "sRGB")]
    foreground: Vec<[f64; 3]>,
    /// A rough matte of the clock's first frame: 0.9 and above is layer, 0.1 and below ground, anything between unknown. A box around the layer will do.
    hint: Option<Frames<Matte>>,
    /// Colour clusters a side. Too few make one cluster span two colours; more cost time.
    #[input(default = 5, range = 1..=32)]
    clusters: u32,
    /// How fast the colours are learnt anew from frame to frame. 0 keeps those of the first frame, 1 forgets all but where the clusters were.
    #[input(default = 0.0, range = 0.0..=1.0)]
    adapt: f64,
    /// The space in which colours cluster.
    #[input(default = lab)]
    space: Space,
    /// Width of the ink that outlines the layer; ink within this distance belongs to the layer. 0 for drawings without ink.
    #[input(default = 4.0, range = 0.0..=1000.0, unit = "px")]
    ink: f64,
    /// Colour of the ink as seen on screen.
    #[input(default = (0.06, 0.05, 0.05), range = 0.0..=1.0, unit = "sRGB")]
    ink_color: [f64; 3],
    /// Share of colours that no cluster explains; they count as ground. 0 makes the nearest cluster answer for any colour.
    #[input(default = 0.01, range = 0.0..=0.5)]
    outlier: f64,
    /// Smallest spread of a cluster, in units of the space: how far from a flat colour its pixels may be.
    #[input(default = 1.0, range = 0.001..=100.0)]
    min_sigma: f64,
    /// How much neighbours of like colour agree: 0 not at all, 1 usual, 3 for coarse grain.
    #[input(default = 1.0, range = 0.0..=100.0)]
    smoothness: f64,
    /// Parts of the layer smaller than this are removed; 0 keeps all.
    #[input(default = 16.0, range = 0.0.., unit = "px²")]
    min_area: f64,
    /// Holes up to this size are filled; 0 fills none, `inf` all that do not touch the border.
    #[input(default = 64.0, range = 0.0.., unit = "px²")]
    fill_holes: f64,
    /// Holes count as closed where gaps up to this width in the drawing let the ground in. 0 fills closed ones only.
    #[input(default = 0.0, range = 0.0..=64.0, unit = "px")]
    close_gaps: f64,
    /// Keep the largest part of the layer only.
    #[input(default = false)]
    largest_component: bool,
    /// Probabilities up to the first number become 0, those from the second on 1. (0, 1) keeps them all.
    #[input(default = (0.1, 0.9), range = 0.0..=1.0)]
    clip: [f64; 2],
    /// Half the width of the mixed edge: 0 leaves the probability as it is, 1 suits drawings, 2 or 3 soft footage.
    #[input(default = 1.0, range = 0.0..=16.0, unit = "px")]
    edge: f64,
    /// How the pixels of the edge were mixed.
    #[input(default = linear)]
    mix: Mix,
}

/// The matte, and what it says about itself.
#[derive(Outputs)]
pub(crate) struct MatteColorClustersOutputs {
    /// Probability of the layer, 0 to 1, in the footage's format.
    alpha: Matte,
    /// Share of the picture that is layer, 0 to 1.
    area: Curve,
    /// Share of pixels that the colours alone get wrong if the model is right, 0 to 0.5.
    ambiguity: Curve,
    /// Mean log likelihood of a pixel, in nats: a fall says that new colours came into the picture.
    log_likelihood: Curve,
    /// Smallest Bhattacharyya distance between a colour of the layer and one of the ground: below 1 they are confused, above 3 hardly.
    separation: Curve,
}

/// What is remembered of the colours.
#[derive(Clone, Debug, PartialEq, Value)]
pub(crate) struct ColorModel {
    /// Clusters of the layer: weight, mean, covariance by rows.
    #[value(shape = "[k, 13]")]
    foreground: Vec<[f64; 13]>,
    /// Clusters of the ground.
    #[value(shape = "[k, 13]")]
    background: Vec<[f64; 13]>,
    /// Clusters of the ink.
    #[value(shape = "[k, 13]")]
    ink: Vec<[f64; 13]>,
    /// Shares of the layer, of ink, and of what no cluster explains.
    #[value(shape = "[3]")]
    shares: [f64; 3],
}

fn pack(cluster: &Gaussian) -> [f64; 13] {
    let mut out = [cluster.weight; 13];
    out[1..4].copy_from_slice(&cluster.mean);
    out[4..].copy_from_slice(cluster.covariance.as_flattened());
    out
}

fn unpack(packed: &[f64; 13]) -> Gaussian {
    let [weight, x, y, z, xx, xy, xz, yx, yy, yz, zx, zy, zz] = *packed;
    Gaussian { weight, mean: [x, y, z], covariance: [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] }
}

impl ColorModel {
    fn new(model: &Model) -> Self {
        let side = |clusters: &[Gaussian]| clusters.iter().map(pack).collect();
        Self {
            foreground: side(&model.foreground),
            background: side(&model.background),
            ink: side(&model.ink),
            shares: [model.prior, model.ink_prior, model.outlier],
        }
    }

    fn model(&self, space: Space) -> Model {
        let side = |clusters: &[[f64; 13]]| clusters.iter().map(unpack).collect();
        let [prior, ink_prior, outlier] = self.shares;
        Model {
            foreground: side(&self.foreground),
            background: side(&self.background),
            ink: side(&self.ink),
            prior,
            ink_prior,
            outlier,
            space,
        }
    }
}

fn refused(error: MatteError) -> NodeError {
    NodeError::input(error.to_string())
}

impl MatteColorClusters {
    fn options(&self) -> Options {
        Options {
            clusters: self.clusters as usize,
            space: self.space,
            ink: self.ink,
            ink_color: self.ink_color,
            outlier: self.outlier,
            min_sigma: self.min_sigma,
            smoothness: self.smoothness,
            min_area: self.min_area,
            fill_holes: self.fill_holes,
            close_gaps: self.close_gaps,
            largest_component: self.largest_component,
            clip: (self.clip[0], self.clip[1]),
            edge: self.edge,
            mix: self.mix,
            ..Options::default()
        }
    }

    fn learn(&self, cx: &Context) -> Result<Model, NodeError> {
        let options = self.options();
        let seed = match &self.hint {
            Some(hint) => Seed::Hint(hint.at(cx.clock.first)?.alpha()),
            None => Seed::Colours(&self.foreground),
        };
        algo::fit(self.image.in_display()?.raster(), seed, &options).map_err(refused)
    }
}

impl Recurrent for MatteColorClusters {
    type State = ColorModel;

    fn run(self, state: Option<&ColorModel>, cx: &Context) -> Result<(MatteColorClustersOutputs, ColorModel), NodeError> {
        let options = self.options();
        let mut model = match state {
            Some(state) => state.model(self.space),
            None => self.learn(cx)?,
        };
        let picture = self.image.in_display()?;
        let image = picture.raster();
        let mut alpha = vec![0.0; image.width * image.height];
        let status = algo::alpha(image, &model, &options, &mut alpha).map_err(refused)?;
        let separation = model.separation();
        if self.adapt > 0.0 {
            model = algo::adapt(image, &alpha, &model, self.adapt, &options).map_err(refused)?;
        }
        let alpha =
            Matte::new(image.width, image.height, alpha).ok_or_else(|| NodeError::internal("a matte of another size than its picture"))?;
        let curve = |value| Curve { value };
        let outputs = MatteColorClustersOutputs {
            alpha,
            area: curve(status.area),
            ambiguity: curve(status.ambiguity),
            log_likelihood: curve(status.log_likelihood),
            separation: curve(separation),
        };
        Ok((outputs, ColorModel::new(&model)))
    }

    fn previous(&self, cx: &Context) -> Option<i64> {
        // Without adaption every frame starts from the first, so that they need not wait for each other.
        let from = if self.adapt > 0.0 { cx.frame - 1 } else { cx.clock.first };
        (cx.frame > cx.clock.first).then_some(from)
    }

    fn reads(&self, _input: &str, cx: &Context) -> Vec<i64> {
        if cx.frame == cx.clock.first { vec![cx.frame] } else { Vec::new() }
    }

    fn check(&self) -> Vec<Problem> {
        let mut problems = Vec::new();
        if self.clip[0] >= self.clip[1] {
            problems.push(Problem {
                input: "clip",
                message: format!("expected two numbers in order, found ({}, {})", self.clip[0], self.clip[1]),
            });
        }
        problems
    }
}
