//! Files of meshes: STL, binary and as text, and the triangles of Wavefront OBJ.
//!
//! Sources: the STL format of 3D Systems as the Library of Congress describes it (fdd000505, fdd000506), and the
//! Advanced Visualizer manual, appendix B1.

use std::collections::HashMap;

use super::Triangles;

/// Reads the triangles of a file, by the extension of its name.
///
/// # Errors
/// Where the format is unknown, or the content is not of the format.
pub fn read(name: &str, bytes: &[u8]) -> Result<Triangles, String> {
    let extension = name.rsplit_once('.').map_or("", |(_, extension)| extension).to_ascii_lowercase();
    let triangles = match extension.as_str() {
        "stl" => stl(bytes)?,
        "obj" => obj(bytes)?,
        _ => return Err(format!("the mesh {name} is neither .stl nor .obj; convert it")),
    };
    if triangles.faces.is_empty() {
        return Err(format!("the mesh {name} has no triangles"));
    }
    Ok(triangles)
}

/// Vertices that are equal are one.
#[derive(Default)]
struct Builder {
    triangles: Triangles,
    known: HashMap<[u64; 3], usize>,
}

impl Builder {
    fn vertex(&mut self, vertex: [f64; 3]) -> usize {
        let vertices = &mut self.triangles.vertices;
        *self.known.entry(vertex.map(|part| (part + 0.0).to_bits())).or_insert_with(|| {
            vertices.push(vertex);
            vertices.len() - 1
        })
    }

    fn face(&mut self, corners: [[f64; 3]; 3]) {
        let face = corners.map(|corner| self.vertex(corner));
        self.triangles.faces.push(face);
    }
}

fn stl(bytes: &[u8]) -> Result<Triangles, String> {
    /// Header, and the count behind it.
    const HEAD: usize = 84;
    /// A normal, three corners and two spare bytes.
    const FACE: usize = 50;
    let count = bytes.get(80..HEAD).and_then(|count| count.try_into().ok()).map(u32::from_le_bytes);
    let is_binary = count.is_some_and(|count| {
        (count as usize).checked_mul(FACE).and_then(|size| size.checked_add(HEAD)) == Some(bytes.len())
    });
    let mut builder = Builder::default();
    if !is_binary {
        return stl_text(bytes, builder);
    }
    for face in bytes.get(HEAD..).unwrap_or_default().chunks_exact(FACE) {
        let (parts, _) = face.get(12..48).unwrap_or_default().as_chunks::<4>();
        let parts: Vec<f64> = parts.iter().map(|part| f64::from(f32::from_le_bytes(*part))).collect();
        if parts.iter().any(|part| !part.is_finite()) {
            return Err("the mesh has a vertex that is not three finite numbers".to_owned());
        }
        if let [a, b, c, d, e, f, g, h, i] = parts[..] {
            builder.face([[a, b, c], [d, e, f], [g, h, i]]);
        }
    }
    Ok(builder.triangles)
}

fn stl_text(bytes: &[u8], mut builder: Builder) -> Result<Triangles, String> {
    let text = std::str::from_utf8(bytes).map_err(|_| "the mesh is neither binary STL nor text".to_owned())?;
    if !text.trim_start().starts_with("solid") {
        return Err("the mesh is neither binary STL nor begins with `solid`".to_owned());
    }
    let mut corners = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let Some(rest) = line.trim().strip_prefix("vertex") else { continue };
        corners.push(three(rest).ok_or_else(|| format!("line {}: expected `vertex x y z`", index + 1))?);
    }
    let (faces, rest) = corners.as_chunks::<3>();
    if !rest.is_empty() {
        return Err("the mesh has a triangle with fewer than three vertices".to_owned());
    }
    faces.iter().for_each(|face| builder.face(*face));
    Ok(builder.triangles)
}

fn three(text: &str) -> Option<[f64; 3]> {
    let parts: Vec<f64> = text.split_whitespace().take(3).map(str::parse).collect::<Result<_, _>>().ok()?;
    parts.try_into().ok().filter(|parts: &[f64; 3]| parts.iter().all(|part| part.is_finite()))
}

fn obj(bytes: &[u8]) -> Result<Triangles, String> {
    let text = std::str::from_utf8(bytes).map_err(|_| "the mesh is not text".to_owned())?;
    let mut triangles = Triangles::default();
    for (index, line) in text.lines().enumerate() {
        let wrong = |expected: &str| format!("line {}: expected {expected}", index + 1);
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => triangles.vertices.push(three(&line.trim_start()[1..]).ok_or_else(|| wrong("`v x y z`"))?),
            Some("f") => {
                let count = triangles.vertices.len();
                let corners: Option<Vec<usize>> = words.map(|word| corner(word, count)).collect();
                let corners = corners
                    .filter(|corners| corners.len() >= 3)
                    .ok_or_else(|| wrong("a face of three vertices that are there"))?;
                // A polygon is a fan about its first corner.
                let fan = corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]]);
                triangles.faces.extend(fan);
            }
            _ => {}
        }
    }
    Ok(triangles)
}

/// `V`, `V/T`, `V/T/N` or `V//N`; counted from 1, or, negative, from the last.
fn corner(word: &str, count: usize) -> Option<usize> {
    let index: i64 = word.split('/').next()?.parse().ok()?;
    let count = i64::try_from(count).ok()?;
    let index = if index < 0 { count + index } else { index - 1 };
    usize::try_from(index).ok().filter(|_| index < count)
}

#[cfg(test)]
mod tests {

    #[test]
    fn a_tetrahedron_is_the_same_from_every_format() {
        let obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1/1 2/2 4/4\nf 1//1 4//1 3//1\nf -3 -2 -1\n";
        let read = super::read("t.obj", obj).unwrap();
        assert_eq!((read.vertices.len(), read.faces.len()), (4, 4));
        let (mut text, mut binary) = (String::from("solid t\n"), vec![0_u8; 80]);
        binary.extend(4_u32.to_le_bytes());
        for face in &read.faces {
            text.push_str("facet normal 0 0 0\nouter loop\n");
            binary.extend([0_u8; 12]);
            for vertex in face.map(|index| read.vertices[index]) {
                text.push_str(&format!("vertex {} {} {}\n", vertex[0], vertex[1], vertex[2]));
                binary.extend(vertex.iter().flat_map(|part| (*part as f32).to_le_bytes()));
            }
            text.push_str("endloop\nendfacet\n");
            binary.extend([0_u8; 2]);
        }
        let (text, binary) = (super::read("t.stl", text.as_bytes()).unwrap(), super::read("t.STL", &binary).unwrap());
        assert_eq!(text, binary);
        assert_eq!((text.vertices.len(), text.faces.len()), (4, 4));
    }

    #[test]
    fn what_is_no_mesh_is_said() {
        for (name, bytes) in [
            ("t.dae", &b""[..]),
            ("t.stl", b"nothing"),
            ("t.stl", b"solid\nvertex 1 2\n"),
            ("t.stl", b"\xff\xfe"),
            ("t.obj", b"v 1 2\n"),
            ("t.obj", b"v 1 2 3\nf 1 2 3\n"),
            ("t.obj", b"v nan 2 3\n"),
            ("t.obj", b""),
        ] {
            assert!(super::read(name, bytes).is_err(), "{name} {bytes:?}");
        }
    }
}
