//! One Gaussian of a mixture over colours, and its closed forms.

/// ln 2π.
const LN_TAU: f64 = 1.837_877_066_409_345_5;

/// One component of a mixture: a weight and a normal distribution over the three coordinates of the colour space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaussian {
    /// Share of its side, 0 to 1; the weights of a side sum to 1.
    pub weight: f64,
    /// Centre, in units of the colour space.
    pub mean: [f64; 3],
    /// Covariance (3×3, symmetric, positive definite), squared units.
    pub covariance: [[f64; 3]; 3],
}

/// The inverse Cholesky factor of a covariance and its logarithmic norm: what evaluating the density takes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Whitening {
    pub(super) mean: [f64; 3],
    /// Lower triangle by rows: (0,0), (1,0), (1,1), (2,0), (2,1), (2,2).
    pub(super) rows: [f64; 6],
    /// ln of the density at the mean.
    pub(super) log_norm: f64,
}

impl Whitening {
    /// ln of the density at `x`: `log_norm` less half the squared Mahalanobis distance.
    pub(super) fn log_density(&self, x: [f64; 3]) -> f64 {
        let d = [x[0] - self.mean[0], x[1] - self.mean[1], x[2] - self.mean[2]];
        let r = &self.rows;
        let y = [r[0] * d[0], r[1] * d[0] + r[2] * d[1], r[3] * d[0] + r[4] * d[1] + r[5] * d[2]];
        self.log_norm - 0.5 * (y[0] * y[0] + y[1] * y[1] + y[2] * y[2])
    }
}

/// Lower Cholesky factor (rows as in [`Whitening`]) of a symmetric matrix; `None` where it is not positive definite.
fn cholesky(c: &[[f64; 3]; 3]) -> Option<[f64; 6]> {
    let positive = |v: f64| (v > 0.0 && v.is_finite()).then(|| libm::sqrt(v));
    let l00 = positive(c[0][0])?;
    let (l10, l20) = (c[1][0] / l00, c[2][0] / l00);
    let l11 = positive(c[1][1] - l10 * l10)?;
    let l21 = (c[2][1] - l20 * l10) / l11;
    let l22 = positive(c[2][2] - l20 * l20 - l21 * l21)?;
    Some([l00, l10, l11, l20, l21, l22])
}

impl Gaussian {
    /// A round component of standard deviation `sigma`.
    pub fn round(weight: f64, mean: [f64; 3], sigma: f64) -> Self {
        let mut covariance = [[0.0; 3]; 3];
        for (i, row) in covariance.iter_mut().enumerate() {
            row[i] = sigma * sigma;
        }
        Self { weight, mean, covariance }
    }

    /// The whitening of the covariance; `None` where it is not positive definite or not finite.
    pub(super) fn whitening(&self) -> Option<Whitening> {
        let l = cholesky(&self.covariance)?;
        let (i0, i1, i2) = (1.0 / l[0], 1.0 / l[2], 1.0 / l[5]);
        let r10 = -l[1] * i0 * i1;
        let r20 = (l[1] * l[4] * i1 - l[3]) * i0 * i2;
        let rows = [i0, r10, i1, r20, -l[4] * i1 * i2, i2];
        let log_norm = -1.5 * LN_TAU + libm::log(i0) + libm::log(i1) + libm::log(i2);
        Some(Whitening { mean: self.mean, rows, log_norm })
    }

    /// ln of the density at `x`, without the weight; `None` for a covariance that is not positive definite.
    pub fn log_density(&self, x: [f64; 3]) -> Option<f64> {
        self.whitening().map(|w| w.log_density(x))
    }

    /// The Bhattacharyya distance to another component (0 for equal ones; above 2 they hardly overlap: the error of telling them apart is below e⁻² / 2).
    ///
    /// **Source** A. Bhattacharyya, 1943, for normal distributions: ⅛ dᵀ S⁻¹ d + ½ ln(det S / √(det A det B)), S the mean covariance.
    pub fn bhattacharyya(&self, other: &Self) -> Option<f64> {
        let mut mean = Self { weight: 1.0, ..*self };
        for i in 0..3 {
            for j in 0..3 {
                mean.covariance[i][j] = 0.5 * (self.covariance[i][j] + other.covariance[i][j]);
            }
        }
        let (a, b, s) = (self.whitening()?, other.whitening()?, mean.whitening()?);
        let mahalanobis_sq = -2.0 * (s.log_density(other.mean) - s.log_norm);
        // The norms hold −½ ln det, the rest of them cancelling.
        Some(mahalanobis_sq / 8.0 + 0.5 * (a.log_norm + b.log_norm) - s.log_norm)
    }
}
