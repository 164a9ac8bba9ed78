//! Writing a safetensors file: eight bytes of header length, a JSON header, the numbers.
//!
//! Written by hand because the order of the file must not depend on a hash map: the same state
//! always gives the same bytes.

use std::fmt::Write as _;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use super::{Numbers, SaveError, State};

impl State {
    /// Writes a safetensors file, whole or not at all: first beside it, then renamed. Its data is
    /// on the disk when this returns, and others may read it as the umask has it. Arrays that were read and are neither of
    /// real numbers nor of counts are left out: only their names are kept.
    ///
    /// # Errors
    /// If the folder or the disk refuses; an earlier file of that name is then untouched.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<(), SaveError> {
        let path = path.as_ref();
        self.write_atomic(path).map_err(|source| SaveError { path: path.to_owned(), source })
    }

    fn write_atomic(&self, path: &Path) -> io::Result<()> {
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let mut builder = tempfile::Builder::new();
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // Temporary files are private; this one becomes an ordinary file.
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let mut file = builder.tempfile_in(folder)?;
        {
            let mut out = BufWriter::new(file.as_file_mut());
            self.write_to(&mut out)?;
            out.flush()?;
        }
        file.as_file().sync_all()?;
        file.persist(path).map_err(|error| error.error)?;
        // The new name is in the folder. A folder that cannot be opened or synced is no failure: the file is there.
        #[cfg(unix)]
        if let Ok(folder) = std::fs::File::open(folder) {
            folder.sync_all().ok();
        }
        Ok(())
    }

    /// The bytes of the safetensors file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        self.write_to(&mut bytes).expect("a vector takes all bytes");
        bytes
    }

    fn write_to(&self, out: &mut impl Write) -> io::Result<()> {
        let header = self.header();
        out.write_all(&(header.len() as u64).to_le_bytes())?;
        out.write_all(header.as_bytes())?;
        for stored in self.stored() {
            match &stored.numbers {
                Numbers::Halves(x) => x.iter().try_for_each(|x| out.write_all(x))?,
                Numbers::Singles(x) => {
                    x.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))?;
                }
                Numbers::Doubles(x) => {
                    x.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))?;
                }
                Numbers::Counts(x) => x.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))?,
                Numbers::Other(_) => {}
            }
        }
        Ok(())
    }

    /// What is written: everything but arrays that were read and not understood.
    fn stored(&self) -> impl Iterator<Item = &super::Stored> {
        self.arrays.values().filter(|stored| !matches!(stored.numbers, Numbers::Other(_)))
    }

    fn header(&self) -> String {
        let mut header = String::from("{");
        if !self.metadata.is_empty() {
            header.push_str("\"__metadata__\":{");
            for (k, (key, value)) in self.metadata.iter().enumerate() {
                let comma = if k == 0 { "" } else { "," };
                let _ = write!(header, "{comma}{}:{}", quoted(key), quoted(value));
            }
            header.push('}');
        }
        let mut offset = 0;
        for (name, stored) in &self.arrays {
            let bytes = match &stored.numbers {
                Numbers::Halves(x) => 2 * x.len(),
                Numbers::Singles(x) => 4 * x.len(),
                Numbers::Doubles(x) => 8 * x.len(),
                Numbers::Counts(x) => 8 * x.len(),
                Numbers::Other(_) => continue,
            };
            if header.len() > 1 {
                header.push(',');
            }
            let (kind, end) = (stored.numbers.type_name(), offset + bytes);
            let shape = format!("{:?}", stored.shape).replace(' ', "");
            let _ = write!(
                header,
                "{}:{{\"dtype\":\"{kind}\",\"shape\":{shape},\"data_offsets\":[{offset},{end}]}}",
                quoted(name)
            );
            offset = end;
        }
        header.push('}');
        // Readers map the file and want the numbers aligned.
        while !header.len().is_multiple_of(8) {
            header.push(' ');
        }
        header
    }
}

/// A JSON string.
fn quoted(text: &str) -> String {
    let mut json = String::with_capacity(text.len() + 2);
    json.push('"');
    for c in text.chars() {
        match c {
            '"' => json.push_str("\\\""),
            '\\' => json.push_str("\\\\"),
            c if (c as u32) < 0x20 => {
                let _ = write!(json, "\\u{:04x}", c as u32);
            }
            c => json.push(c),
        }
    }
    json.push('"');
    json
}
