//! Meshes from files, for formats that have their triangles, and for distances.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use crate::formats::scene::{Mesh, Object, Solid, Triangles, mesh};

/// Files of meshes that were read.
#[derive(Debug, Default)]
pub struct Meshes {
    folder: PathBuf,
    known: HashMap<String, Result<Triangles, String>>,
}

impl Meshes {
    /// Meshes whose names are relative to a folder.
    #[must_use]
    pub fn in_folder(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), known: HashMap::new() }
    }

    /// Puts triangles in place of the names of files.
    ///
    /// # Errors
    /// Where a file cannot be read.
    pub fn load(&mut self, object: &mut Object) -> Result<(), String> {
        for shape in &mut object.shapes {
            if let Solid::Mesh(Mesh::File { file, scale }) = &shape.solid {
                let triangles = self.read(file)?;
                let scaled = triangles.vertices.iter().map(|[x, y, z]| [x * scale[0], y * scale[1], z * scale[2]]);
                let triangles = Triangles { vertices: scaled.collect(), faces: triangles.faces.clone() };
                shape.solid = Solid::Mesh(Mesh::Triangles(triangles));
            }
        }
        Ok(())
    }

    fn read(&mut self, file: &str) -> Result<&Triangles, String> {
        let folder = &self.folder;
        let read = || {
            let path = folder.join(file.strip_prefix("file://").unwrap_or(file));
            let bytes =
                std::fs::read(&path).map_err(|error| format!("its mesh {} cannot be read: {error}", path.display()))?;
            mesh::read(file, &bytes)
        };
        self.known.entry(file.to_owned()).or_insert_with(read).as_ref().map_err(Clone::clone)
    }
}
