//! 3MF, the format of 3D printers that has units, colours and textures. Written, never read.
//!
//! A package of XML parts after the 3MF core specification 1.3, with its materials and properties extension
//! where a mesh has colours or a texture. Coordinates are written as they are; the format takes them for
//! millimetres and +Z for up.

use std::io::{BufWriter, Cursor, Error, Write};
use std::path::Path;

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use super::{EncodeError, WriteError, check, write_atomic};
use crate::{TriMesh, encode_png};

const CONTENT_TYPES: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
 <Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
 <Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
 <Default Extension="png" ContentType="image/png"/>
</Types>
"#;

/// Where the parts are, and of what kind what names them says that they are.
const MODEL: (&str, &str) = ("3D/3dmodel.model", "3dmodel");
const TEXTURE: (&str, &str) = ("3D/Textures/surface.png", "3dtexture");

/// Resources of the model; what is named comes before what names it.
const TEXTURE_ID: u32 = 1;
const COLORS_ID: u32 = 2;
const OBJECT_ID: u32 = 3;

/// Bytes that the longest vertex, colour and triangle may take, roughly.
const LONGEST: u64 = 400;

/// Writes a 3MF file; of a mesh that has both colours and a texture it holds the texture.
///
/// Faces that name a vertex twice, which the format forbids, are left out.
///
/// # Errors
/// The file cannot be written, or the mesh has an index out of range or a number that is not finite.
pub fn write(path: impl AsRef<Path>, mesh: &TriMesh) -> Result<(), WriteError> {
    let path = path.as_ref();
    let bytes = encode(mesh).map_err(|e| e.at(path))?;
    write_atomic(path, |w| w.write_all(&bytes))
}

/// A 3MF file in memory; the same mesh always gives the same bytes.
///
/// # Errors
/// The mesh has an index out of range or a number that is not finite.
pub fn encode(mesh: &TriMesh) -> Result<Vec<u8>, EncodeError> {
    check::writable(mesh)?;
    Ok(package(mesh).expect("writing to memory"))
}

fn package(mesh: &TriMesh) -> std::io::Result<Vec<u8>> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let deflated = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Deflated)
        .last_modified_time(DateTime::default())
        .unix_permissions(0o644);
    zip.start_file("[Content_Types].xml", deflated)?;
    zip.write_all(CONTENT_TYPES.as_bytes())?;
    zip.start_file("_rels/.rels", deflated)?;
    relationship(&mut zip, MODEL)?;
    let longest = LONGEST * (mesh.positions.len() + mesh.faces.len()) as u64;
    zip.start_file(MODEL.0, deflated.large_file(longest > u64::from(u32::MAX)))?;
    let mut buffered = BufWriter::new(&mut zip);
    model(&mut buffered, mesh)?;
    buffered.flush()?;
    drop(buffered);
    if let Some(texture) = &mesh.texture {
        zip.start_file("3D/_rels/3dmodel.model.rels", deflated)?;
        relationship(&mut zip, TEXTURE)?;
        // It is packed already.
        zip.start_file(TEXTURE.0, deflated.compression_method(CompressionMethod::Stored))?;
        zip.write_all(&encode_png(&texture.image.to_bytes()))?;
    }
    Ok(zip.finish().map_err(Error::other)?.into_inner())
}

fn relationship(w: &mut impl Write, (target, kind): (&str, &str)) -> std::io::Result<()> {
    writeln!(
        w,
        r#"<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
 <Relationship Id="rel0" Target="/{target}" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/{kind}"/>
</Relationships>"#
    )
}

fn model(w: &mut impl Write, mesh: &TriMesh) -> std::io::Result<()> {
    writeln!(
        w,
        r#"<?xml version="1.0" encoding="UTF-8"?>
<model unit="millimeter" xml:lang="en-US" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02">
 <metadata name="Application">mesh-core {}</metadata>
 <resources>"#,
        env!("CARGO_PKG_VERSION")
    )?;
    let has_properties = properties(w, mesh)?;
    object(w, mesh, has_properties)?;
    writeln!(w, " </resources>\n <build>\n  <item objectid=\"{OBJECT_ID}\"/>\n </build>\n</model>")
}

/// What the corners of triangles may name; whether there is anything.
fn properties(w: &mut impl Write, mesh: &TriMesh) -> std::io::Result<bool> {
    if let Some(texture) = &mesh.texture {
        let path = TEXTURE.0;
        writeln!(
            w,
            r#"  <m:texture2d id="{TEXTURE_ID}" path="/{path}" contenttype="image/png"/>
  <m:texture2dgroup id="{COLORS_ID}" texid="{TEXTURE_ID}">"#
        )?;
        for [u, v] in &texture.uvs {
            writeln!(w, r#"   <m:tex2coord u="{u}" v="{v}"/>"#)?;
        }
        writeln!(w, "  </m:texture2dgroup>")?;
    } else if let Some(colors) = &mesh.colors {
        writeln!(w, r#"  <m:colorgroup id="{COLORS_ID}">"#)?;
        for color in colors {
            let [r, g, b] = color.map(|x| (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
            writeln!(w, r##"   <m:color color="#{r:02X}{g:02X}{b:02X}"/>"##)?;
        }
        writeln!(w, "  </m:colorgroup>")?;
    }
    Ok(mesh.texture.is_some() || mesh.colors.is_some())
}

fn object(w: &mut impl Write, mesh: &TriMesh, has_properties: bool) -> std::io::Result<()> {
    write!(w, r#"  <object id="{OBJECT_ID}" type="model""#)?;
    if has_properties {
        write!(w, r#" pid="{COLORS_ID}" pindex="0""#)?;
    }
    writeln!(w, ">\n   <mesh>\n    <vertices>")?;
    for [x, y, z] in &mesh.positions {
        writeln!(w, r#"     <vertex x="{x}" y="{y}" z="{z}"/>"#)?;
    }
    writeln!(w, "    </vertices>\n    <triangles>")?;
    for (index, face) in mesh.faces.iter().enumerate() {
        let [a, b, c] = face;
        if a == b || b == c || c == a {
            continue;
        }
        write!(w, r#"     <triangle v1="{a}" v2="{b}" v3="{c}""#)?;
        if has_properties {
            let [p, q, r] = mesh.texture.as_ref().map_or(*face, |texture| texture.faces[index]);
            write!(w, r#" pid="{COLORS_ID}" p1="{p}" p2="{q}" p3="{r}""#)?;
        }
        writeln!(w, "/>")?;
    }
    writeln!(w, "    </triangles>\n   </mesh>\n  </object>")
}
