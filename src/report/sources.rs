//! How the numbers of a report are defined, and where their formulas come from.

use crate::manifest::PartsBy;
use serde::Serialize;

/// A quantity, its definition and its source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Definition {
    /// What it is called.
    pub quantity: &'static str,
    /// How it is computed.
    pub definition: &'static str,
    /// What to cite.
    pub source: &'static str,
}

const fn definition(
    quantity: &'static str,
    definition: &'static str,
    source: &'static str,
) -> Definition {
    Definition {
        quantity,
        definition,
        source,
    }
}

/// What a cell is: of connected components, of cells that were split, and of those of labels.
const CELL: [&str; 3] = [
    "cell, object",
    "cell (split), component, object",
    "cell (labels), component, object",
];
/// Of cells that were split alone.
const OF_SPLIT: [&str; 2] = ["split", "neck, neck radius"];

/// Those that a set with cells of this kind needs.
pub(super) fn definitions(cells: Option<&PartsBy>) -> Vec<Definition> {
    let own = match cells {
        None => CELL[0],
        Some(PartsBy::Split { .. }) => CELL[1],
        Some(PartsBy::Labels { .. }) => CELL[2],
    };
    let is_split = own == CELL[1];
    let needed = |d: &Definition| {
        let quantity = &d.quantity;
        *quantity == own || !CELL.contains(quantity) && (is_split || !OF_SPLIT.contains(quantity))
    };
    DEFINITIONS.into_iter().filter(needed).collect()
}

/// In the order of the report.
pub const DEFINITIONS: [Definition; 17] = [
    definition(
        "surface",
        "Marching cubes at the threshold; vertices linear between two voxels, on a lattice of 1/256 voxel. On an ambiguous \
         face the rule of the index separates or joins the two corners above.",
        "W. E. Lorensen, H. E. Cline, Computer Graphics (SIGGRAPH) 21(4), 1987, 163-169",
    ),
    definition(
        CELL[0],
        "Connected voxels below and at or above the threshold. Rule separate: cells over faces and edges (18 neighbours), \
         objects over faces (6); rule join: the other way round.",
        "A. Rosenfeld, Journal of the ACM 17, 1970, 146-160",
    ),
    definition(
        CELL[1],
        "Components are connected voxels below the threshold, objects those at or above it. Rule separate: components over \
         faces and edges (18 neighbours), objects over faces (6); rule join: the other way round. A cell is a component, or \
         a part of one that was cut from the others at necks.",
        "A. Rosenfeld, Journal of the ACM 17, 1970, 146-160",
    ),
    definition(
        CELL[2],
        "Components are connected voxels below the threshold, objects those at or above it. Rule separate: components over \
         faces and edges (18 neighbours), objects over faces (6); rule join: the other way round. A cell is the voxels below \
         that have one label in the file of labels; those with label 0 are one more.",
        "A. Rosenfeld, Journal of the ACM 17, 1970, 146-160",
    ),
    definition(
        OF_SPLIT[0],
        "The radius of a voxel below is its distance to the nearest voxel above. From each voxel the steepest way up leads to a \
         summit. Two hills are one cell unless the highest pass between them has at most the ratio times the radius of the \
         lower summit, and less than it by h at least, and that summit has the smallest radius at least.",
        "F. Meyer, Signal Processing 38, 1994, 113-125; H. Carr, J. Snoeyink, U. Axen, Computational Geometry 24, 2003, 75-94",
    ),
    definition(
        OF_SPLIT[1],
        "A neck is where two cells of a component touch. Its radius is that of the highest pass between them: of the largest \
         ball that goes through. Its ratio is this by the radius of the lower summit, where the two were cut from each other.",
        "F. Meyer, Signal Processing 38, 1994, 113-125",
    ),
    definition(
        "porosity",
        "Voxels below the threshold by all voxels that count.",
        "E. E. Underwood, Quantitative Stereology, Addison-Wesley, 1970 (volume fraction by point counting)",
    ),
    definition(
        "equivalent diameter",
        "(6 V / pi)^(1/3) with the volume V of the voxels.",
        "H. Wadell, Journal of Geology 40, 1932, 443-451 (nominal diameter)",
    ),
    definition(
        "sphericity",
        "pi^(1/3) (6 V)^(2/3) / A with volume V and area A of the triangles: the area of the ball with the cell's volume \
         by the area of the cell.",
        "H. Wadell, Journal of Geology 43, 1935, 250-280",
    ),
    definition(
        "elongation, flatness",
        "b / a and c / b of the semi-axes a >= b >= c of the ellipsoid with the same second moments.",
        "Th. Zingg, Schweizerische Mineralogische und Petrographische Mitteilungen 15, 1935, 39-140, for the ratios",
    ),
    definition(
        "number density, mean volume (edge corrected)",
        "Each whole cell with a box of bx x by x bz voxels counts by 1 / ((nx - bx - 1) (ny - by - 1) (nz - bz - 1)), in a \
         voxel's volume, in a grid of nx x ny x nz voxels; cells at the border do not count.",
        "R. E. Miles, in Stochastic Geometry, Wiley, 1974, 228-247; C. Lantuéjoul, in Geometrical Probability and \
         Biological Structures, Springer, 1978, 323-329",
    ),
    definition(
        "porosity of boxes",
        "Boxes that are as nearly cubes as blocks of voxels allow, side by side and without overlap, and one in the \
         middle: from which size on their spread is small, a box stands for the whole.",
        "J. Bear, Dynamics of Fluids in Porous Media, Elsevier, 1972, chapter 1",
    ),
    definition(
        "fabric tensor, isotropy",
        "sum(A n n^T) / sum(A) over the triangles with unit normals n and areas A; isotropy is its least eigenvalue by \
         its greatest.",
        "E. D. Wetzel, C. L. Tucker, International Journal of Multiphase Flow 25, 1999, 35-61; G. E. Schröder-Turk et \
         al., New Journal of Physics 15, 2013, 083028",
    ),
    definition(
        "mean intercept length",
        "L(d) = 2 V / sum(A |n . d|) of lines along d in cells of volume V; 4 V / A over all directions.",
        "E. E. Underwood, Quantitative Stereology, Addison-Wesley, 1970 (Cauchy's formula)",
    ),
    definition(
        "degree of anisotropy",
        "The longest by the shortest semi-axis of the ellipsoid that fits L(d) best in 31 directions: d^T M d = 1 / L(d)^2.",
        "W. J. Whitehouse, Journal of Microscopy 101, 1974, 153-168; T. P. Harrigan, R. W. Mann, Journal of Materials \
         Science 19, 1984, 761-767",
    ),
    definition(
        "wall, its area and thickness, neighbours",
        "Lines of voxels from a cell through material to another have a chord each. A wall is as thick as the median of these \
         by the area that they stand for, each times the cosine between line and normal. Its cells are neighbours if its area \
         is at least 5 faces of a voxel and 0.5 % of the smaller cell's, and if it is at most 1.8 times as thick as the walls \
         of one of them; so are cells that are open to each other.",
        "H. J. G. Gundersen, T. B. Jensen, R. Østerby, Journal of Microscopy 113, 1978, 27-43, for thickness from \
         intercepts",
    ),
    definition(
        "outlier",
        "Beyond a quartile by more than 1.5 times the distance between the quartiles: of the diameter at both ends, of \
         sphericity, elongation and flatness below.",
        "J. W. Tukey, Exploratory Data Analysis, Addison-Wesley, 1977, chapter 2",
    ),
];
