//! Local planes: height over x and y about a cell's centre.

/// `z = height + slope . (xy - centre)`, metres.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Plane {
    pub(super) centre: [f64; 2],
    pub(super) height: f64,
    pub(super) slope: [f64; 2],
}

impl Plane {
    #[inline]
    pub(super) fn at(&self, xy: [f64; 2]) -> f64 {
        self.height + self.slope[0] * (xy[0] - self.centre[0]) + self.slope[1] * (xy[1] - self.centre[1])
    }

    /// Adds a correction `[a, b, c]` as [`Correction::solve`] gives it, `per_edge` being 1 / the unit of its offsets.
    pub(super) fn correct(&mut self, [a, b, c]: [f64; 3], per_edge: f64) {
        self.height += a;
        self.slope = [self.slope[0] + b * per_edge, self.slope[1] + c * per_edge];
    }

    /// The same plane, described about another centre.
    pub(super) fn moved_to(&self, centre: [f64; 2]) -> Self {
        Self { centre, height: self.at(centre), slope: self.slope }
    }
}

/// Weighted least squares for a correction `a + b dx + c dy` to a plane, pulled towards no correction.
#[derive(Clone, Copy, Default)]
pub(super) struct Correction {
    w: f64,
    wx: f64,
    wy: f64,
    wxx: f64,
    wxy: f64,
    wyy: f64,
    wr: f64,
    wxr: f64,
    wyr: f64,
}

impl Correction {
    /// Adds a residual `r` at the offset `(x, y)` from the centre, both in units of the cell's edge.
    #[inline]
    pub(super) fn add(&mut self, x: f64, y: f64, r: f64, weight: f64) {
        let (wx, wy) = (weight * x, weight * y);
        self.w += weight;
        self.wx += wx;
        self.wy += wy;
        self.wxx += wx * x;
        self.wxy += wx * y;
        self.wyy += wy * y;
        self.wr += weight * r;
        self.wxr += wx * r;
        self.wyr += wy * r;
    }

    /// `[a, b, c]` with the weights of the pull on height and slope; zero where nothing was added.
    pub(super) fn solve(&self, pull_height: f64, pull_slope: f64) -> [f64; 3] {
        if self.w <= 0.0 {
            return [0.0; 3];
        }
        // Cholesky-free elimination of a 3 x 3 system that the pull keeps positive definite.
        let (m00, m01, m02) = (self.w + pull_height, self.wx, self.wy);
        let (m11, m12, m22) = (self.wxx + pull_slope, self.wxy, self.wyy + pull_slope);
        let (f1, f2) = (m01 / m00, m02 / m00);
        let (n11, n12, n22) = (m11 - f1 * m01, m12 - f1 * m02, m22 - f2 * m02);
        let (r1, r2) = (self.wxr - f1 * self.wr, self.wyr - f2 * self.wr);
        let f = n12 / n11;
        let c = (r2 - f * r1) / (n22 - f * n12);
        let b = (r1 - n12 * c) / n11;
        let a = (self.wr - m01 * b - m02 * c) / m00;
        [a, b, c]
    }
}
