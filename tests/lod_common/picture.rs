//! Pictures of triangles from a point, by the signs of determinants: triangles that share an edge leave no pixel between
//! them, and none has to be clipped.

/// A triangle of a cell's surface.
#[derive(Debug, Clone, Copy)]
pub struct Drawn {
    pub cell: u64,
    pub corners: [[f64; 3]; 3],
}

impl Drawn {
    pub fn new(cell: u64, corners: [[f32; 3]; 3]) -> Self {
        Drawn {
            cell,
            corners: corners.map(|p| p.map(f64::from)),
        }
    }
}

type Vector = [f64; 3];

fn cross(u: Vector, v: Vector) -> Vector {
    [
        u[1] * v[2] - u[2] * v[1],
        u[2] * v[0] - u[0] * v[2],
        u[0] * v[1] - u[1] * v[0],
    ]
}

fn dot(u: Vector, v: Vector) -> f64 {
    u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
}

/// One face of a cube of pixels around the eye: what is nearest in each.
struct Face {
    side: usize,
    depths: Vec<f64>,
    cells: Vec<u64>,
}

impl Face {
    /// The coordinate of a pixel's middle, from -1 to 1.
    fn middle(&self, pixel: usize) -> f64 {
        (pixel as f64 + 0.5) / self.side as f64 * 2.0 - 1.0
    }

    /// The pixels that a triangle may cover along an axis.
    fn range(&self, corners: &[Vector; 3], axis: usize) -> std::ops::Range<usize> {
        let is_near = corners.iter().any(|c| c[2] < 1e-3);
        if is_near {
            return 0..self.side;
        }
        let all = corners.map(|c| c[axis] / c[2]);
        let low = all.iter().copied().fold(f64::INFINITY, f64::min);
        let high = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let pixel = |v: f64| ((v + 1.0) / 2.0 * self.side as f64).clamp(0.0, self.side as f64);
        let (first, end) = (pixel(low).floor() as usize, pixel(high).ceil() as usize);
        first.saturating_sub(1)..(end + 1).min(self.side)
    }

    /// Draws a triangle whose corners are given by right, up and forward.
    fn draw(&mut self, cell: u64, corners: [Vector; 3]) {
        if corners.iter().all(|c| c[2] <= 0.0) {
            return;
        }
        let [a, b, c] = corners;
        // the reverse of an edge is its negative to the last bit
        let sides = [cross(a, b), cross(b, c), cross(c, a)];
        let minus = |u: Vector, v: Vector| [u[0] - v[0], u[1] - v[1], u[2] - v[2]];
        let normal = cross(minus(b, a), minus(c, a));
        let far = dot(normal, a);
        let (columns, rows) = (self.range(&corners, 0), self.range(&corners, 1));
        for row in rows {
            let y = self.middle(row);
            for column in columns.clone() {
                let ray = [self.middle(column), y, 1.0];
                let signs = sides.map(|s| dot(s, ray));
                let inside = signs.iter().all(|s| *s >= 0.0) || signs.iter().all(|s| *s <= 0.0);
                let depth = far / dot(normal, ray);
                let at = row * self.side + column;
                if inside && depth > 0.0 && depth < self.depths[at] {
                    self.depths[at] = depth;
                    self.cells[at] = cell;
                }
            }
        }
    }
}

/// Of six pictures of `side` x `side` pixels around an eye, how many pixels show something else than a cell's surface.
pub fn others(scene: &[Drawn], eye: [f64; 3], cell: u64, side: usize) -> usize {
    let mut wrong = 0;
    for (axis, way) in [
        (0, 1.0),
        (0, -1.0),
        (1, 1.0),
        (1, -1.0),
        (2, 1.0),
        (2, -1.0),
    ] {
        let mut face = Face {
            side,
            depths: vec![f64::INFINITY; side * side],
            cells: vec![0; side * side],
        };
        let seen = |p: [f64; 3]| {
            let v = [0, 1, 2].map(|a| p[a] - eye[a]);
            [v[(axis + 1) % 3], v[(axis + 2) % 3], way * v[axis]]
        };
        for t in scene {
            face.draw(t.cell, t.corners.map(seen));
        }
        wrong += face.cells.iter().filter(|c| **c != cell).count();
    }
    wrong
}
