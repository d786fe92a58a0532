/// Memory of this process that is not swapped out.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ProcessMemory {
    /// Now (MB).
    pub resident_mb: f64,
    /// The most so far (MB).
    pub peak_mb: f64,
}

impl ProcessMemory {
    /// As Linux tells it; `None` elsewhere.
    pub fn now() -> Option<Self> {
        let status = std::fs::read_to_string("/proc/self/status").ok()?;
        let mb = |name: &str| -> Option<f64> {
            let line = status.lines().find_map(|l| l.strip_prefix(name))?;
            let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
            Some(kib * 1024.0 * 1e-6)
        };
        Some(Self {
            resident_mb: mb("VmRSS:")?,
            peak_mb: mb("VmHWM:")?,
        })
    }
}
