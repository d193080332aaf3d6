//! Small readers of PLY, STL, OBJ and GLB that share nothing with the library, and what they tell of a
//! mesh.
#![allow(dead_code)] // each test binary uses a part

use crate::common::glb::chunks;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// A mesh as a file has it.
#[derive(Debug, Default, PartialEq)]
pub struct Mesh {
    pub vertices: Vec<[f64; 3]>,
    pub normals: Vec<[f64; 3]>,
    pub triangles: Vec<[usize; 3]>,
    /// Cell of each triangle; 0 for a cap.
    pub cells: Vec<u64>,
    /// Object of each triangle (PLY).
    pub objects: Vec<u64>,
    /// Comments and other text before the mesh.
    pub text: String,
}

/// Reads a file by the end of its name.
pub fn read(path: &Path) -> Mesh {
    let bytes = std::fs::read(path).unwrap();
    match path.extension().unwrap().to_str().unwrap() {
        "ply" => ply(&bytes),
        "stl" => stl(&bytes),
        "obj" => obj(&bytes),
        "glb" => glb(&bytes),
        other => panic!("{other}"),
    }
}

/// Takes numbers from the front of bytes.
struct Take<'a>(&'a [u8]);

impl Take<'_> {
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let (head, rest) = self.0.split_first_chunk().expect("more bytes");
        self.0 = rest;
        *head
    }

    fn number(&mut self, kind: &str) -> f64 {
        match kind {
            "float" => f32::from_le_bytes(self.bytes()).into(),
            "double" => f64::from_le_bytes(self.bytes()),
            "int" => i32::from_le_bytes(self.bytes()).into(),
            "uchar" => self.bytes::<1>()[0].into(),
            other => panic!("{other}"),
        }
    }
}

/// Reads binary little-endian PLY by what its header says.
pub fn ply(bytes: &[u8]) -> Mesh {
    const END: &[u8] = b"end_header\n";
    let end = bytes.windows(END.len()).position(|w| w == END).unwrap() + END.len();
    let text = std::str::from_utf8(&bytes[..end]).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("ply"));
    assert_eq!(lines.next(), Some("format binary_little_endian 1.0"));
    let mut elements: Vec<(String, usize, Vec<Vec<String>>)> = Vec::new();
    for line in lines {
        let words: Vec<String> = line.split_whitespace().map(str::to_string).collect();
        match words[0].as_str() {
            "element" => elements.push((words[1].clone(), words[2].parse().unwrap(), Vec::new())),
            "property" => elements.last_mut().unwrap().2.push(words[1..].to_vec()),
            _ => {}
        }
    }
    let mut mesh = Mesh {
        text: text.to_string(),
        ..Mesh::default()
    };
    let mut take = Take(&bytes[end..]);
    for (name, count, properties) in &elements {
        for _ in 0..*count {
            let mut values: HashMap<&str, f64> = HashMap::new();
            let mut corners = Vec::new();
            for p in properties {
                if p[0] == "list" {
                    let n = take.number(&p[1]) as usize;
                    corners = (0..n).map(|_| take.number(&p[2]) as usize).collect();
                } else {
                    values.insert(&p[1], take.number(&p[0]));
                }
            }
            let three = |names: [&str; 3]| names.map(|n| values[n]);
            if name == "vertex" {
                mesh.vertices.push(three(["x", "y", "z"]));
                mesh.normals.push(three(["nx", "ny", "nz"]));
            } else {
                mesh.triangles.push(corners.try_into().unwrap());
                mesh.cells.push(values["cell"] as u64);
                mesh.objects.push(values["object"] as u64);
            }
        }
    }
    assert!(take.0.is_empty());
    mesh
}

/// Reads binary STL: every triangle has vertices of its own, and its normal at each of them.
pub fn stl(bytes: &[u8]) -> Mesh {
    let mut mesh = Mesh {
        text: String::from_utf8(bytes[..80].to_vec()).unwrap(),
        ..Mesh::default()
    };
    assert!(!mesh.text.starts_with("solid"));
    let count = u32::from_le_bytes(bytes[80..84].try_into().unwrap());
    let mut take = Take(&bytes[84..]);
    for i in 0..count as usize {
        let mut vector = || [0; 3].map(|_: i32| take.number("float"));
        let normal = vector();
        mesh.vertices.extend([vector(), vector(), vector()]);
        mesh.normals.extend([normal; 3]);
        mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
        assert_eq!(take.bytes::<2>(), [0, 0]);
    }
    assert!(take.0.is_empty());
    mesh
}

/// Reads OBJ. A corner must name a vertex that came before, and the normal of the same number.
pub fn obj(bytes: &[u8]) -> Mesh {
    let mut mesh = Mesh::default();
    let mut cell = None;
    for line in std::str::from_utf8(bytes).unwrap().lines() {
        let (key, rest) = line.split_once(' ').unwrap();
        let numbers = || -> [f64; 3] {
            let all: Vec<f64> = rest.split(' ').map(|n| n.parse().unwrap()).collect();
            all.try_into().unwrap()
        };
        match key {
            "#" => mesh.text += &format!("{rest}\n"),
            "v" => mesh.vertices.push(numbers()),
            "vn" => mesh.normals.push(numbers()),
            "g" if rest.starts_with("cap_object_") => cell = Some(0),
            "g" => cell = Some(rest.strip_prefix("cell_").unwrap().parse().unwrap()),
            "f" => {
                let corner = |c: &str| {
                    let (v, n) = c.split_once("//").unwrap();
                    assert_eq!(v, n);
                    let v: usize = v.parse().unwrap();
                    assert!(v <= mesh.vertices.len() && v <= mesh.normals.len());
                    v - 1
                };
                let corners: Vec<usize> = rest.split(' ').map(corner).collect();
                mesh.triangles.push(corners.try_into().unwrap());
                mesh.cells.push(cell.unwrap());
            }
            other => panic!("{other}"),
        }
    }
    mesh
}

/// Reads GLB by its accessors; positions stay in voxels. The cell of a triangle is that of its vertices,
/// which must not differ unless there are caps (0).
pub fn glb(bytes: &[u8]) -> Mesh {
    let (doc, bin) = chunks(bytes);
    let mesh = &doc["meshes"][0]["primitives"][0];
    assert_eq!(mesh["mode"], 4);
    let accessor = |index: &serde_json::Value, kind: &str| -> Vec<f64> {
        let a = &doc["accessors"][index.as_u64().unwrap() as usize];
        let view = &doc["bufferViews"][a["bufferView"].as_u64().unwrap() as usize];
        let number = |v: &serde_json::Value| v.as_u64().unwrap() as usize;
        let width = if a["type"] == "VEC3" { 3 } else { 1 };
        let stride = view["byteStride"]
            .as_u64()
            .map_or(4 * width, |s| s as usize);
        let start = number(&view["byteOffset"]) + number(&a["byteOffset"]);
        let element = |i: usize| {
            let mut take = Take(&bin[start + i * stride..]);
            (0..width).map(|_| take.number(kind)).collect::<Vec<_>>()
        };
        (0..number(&a["count"])).flat_map(element).collect()
    };
    let vectors = |values: Vec<f64>| values.as_chunks::<3>().0.to_vec();
    let attributes = &mesh["attributes"];
    let cells = accessor(&attributes["_FEATURE_ID_0"], "float");
    let corners = accessor(&mesh["indices"], "int");
    let triangles: Vec<[usize; 3]> = corners
        .as_chunks::<3>()
        .0
        .iter()
        .map(|t| t.map(|v| v as usize))
        .collect();
    let out = Mesh {
        vertices: vectors(accessor(&attributes["POSITION"], "float")),
        normals: vectors(accessor(&attributes["NORMAL"], "float")),
        cells: triangles.iter().map(|t| cells[t[0]] as u64).collect(),
        triangles,
        objects: Vec::new(),
        text: doc["nodes"][0]["matrix"].to_string(),
    };
    let a = &doc["accessors"][attributes["POSITION"].as_u64().unwrap() as usize];
    for axis in 0..3 {
        let of = |pick: fn(f64, f64) -> f64| out.vertices.iter().map(|v| v[axis]).reduce(pick);
        assert_eq!(a["min"][axis].as_f64(), of(f64::min));
        assert_eq!(a["max"][axis].as_f64(), of(f64::max));
    }
    out
}

/// What the edges of a mesh tell.
#[derive(Debug, PartialEq, Eq)]
pub struct Edges {
    /// Edges of one triangle.
    pub open: usize,
    /// Vertices with a triangle - edges + triangles.
    pub euler: i64,
}

impl Mesh {
    /// Counts edges. Panics if one has more than two triangles, or two that run along it the same way, if
    /// a triangle has a corner twice, or if a vertex has no triangle.
    pub fn edges(&self) -> Edges {
        let mut edges: BTreeMap<[usize; 2], [u32; 2]> = BTreeMap::new();
        let mut used = vec![false; self.vertices.len()];
        for t in &self.triangles {
            for i in 0..3 {
                let (a, b) = (t[i], t[(i + 1) % 3]);
                assert_ne!(a, b, "{t:?}");
                edges.entry([a.min(b), a.max(b)]).or_default()[usize::from(a > b)] += 1;
                used[a] = true;
            }
        }
        for (edge, count) in &edges {
            assert!(count.iter().all(|&n| n <= 1), "{edge:?}: {count:?}");
        }
        assert!(used.iter().all(|&u| u), "a vertex without a triangle");
        Edges {
            open: edges.values().filter(|c| c[0] + c[1] == 1).count(),
            euler: self.vertices.len() as i64 - edges.len() as i64 + self.triangles.len() as i64,
        }
    }

    /// The signed volume inside.
    pub fn volume(&self) -> f64 {
        let corner = |i: usize| glam::DVec3::from(self.vertices[i]);
        let one = |t: &[usize; 3]| corner(t[0]).dot(corner(t[1]).cross(corner(t[2]))) / 6.0;
        self.triangles.iter().map(one).sum()
    }

    /// The mesh with vertices at the same place made one, as programs do with STL.
    pub fn joined(&self) -> Mesh {
        let mut known: HashMap<[u64; 3], usize> = HashMap::new();
        let mut out = Mesh::default();
        let mut renamed = Vec::new();
        for v in &self.vertices {
            let next = out.vertices.len();
            let place = *known.entry(v.map(f64::to_bits)).or_insert(next);
            if place == next {
                out.vertices.push(*v);
            }
            renamed.push(place);
        }
        out.triangles = self
            .triangles
            .iter()
            .map(|t| t.map(|v| renamed[v]))
            .collect();
        out
    }

    /// The triangles in lattice units with the smallest corner first, and their cells. For meshes in
    /// voxel coordinates.
    pub fn lattice(&self) -> BTreeMap<[[i32; 3]; 3], u64> {
        let point = |i: usize| {
            self.vertices[i].map(|v| {
                let steps = v * 256.0;
                // text has as many digits as a float of 32 bits needs
                assert!((steps - steps.round()).abs() < 1e-3, "{v}");
                steps.round() as i32
            })
        };
        let triangles = self.triangles.iter().map(|t| t.map(point));
        let cells = self.cells.iter().copied().chain(std::iter::repeat(0));
        triangles
            .map(crate::common::glb::canonical)
            .zip(cells)
            .collect()
    }
}
