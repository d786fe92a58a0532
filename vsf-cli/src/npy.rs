use crate::console::write_file;
use std::path::Path;

/// Writes a `(rows, cols)` array of f64 in NumPy's format 1.0.
pub fn write_rows(path: &Path, rows: &[Vec<f64>]) -> anyhow::Result<()> {
    let cols = rows.first().map_or(0, Vec::len);
    let shape = format!("({}, {cols})", rows.len());
    let dict = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}");
    // Magic, version and length take 10 bytes; the header ends in a newline at a multiple of 64.
    let padded = (10 + dict.len() + 1).next_multiple_of(64) - 10;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((padded as u16).to_le_bytes());
    bytes.extend(format!("{dict:<0$}\n", padded - 1).bytes());
    bytes.extend(rows.iter().flatten().flat_map(|v| v.to_le_bytes()));
    write_file(path, &bytes)
}
