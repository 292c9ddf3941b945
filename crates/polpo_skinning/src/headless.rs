//! A wgpu device without a window, for tests, benches and tools.

/// A device with its queue and what it runs on.
#[derive(Debug)]
pub struct Headless {
    /// The device, with the adapter's own limits.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    /// Name, backend and driver of the adapter.
    pub info: wgpu::AdapterInfo,
}

/// Why there is no device.
#[derive(Debug, thiserror::Error)]
pub enum HeadlessError {
    /// The program was compiled without any wgpu backend (features `vulkan`, `metal`, `dx12`, `gles` of wgpu).
    #[error("no wgpu backend is compiled in")]
    NoBackend,
    /// No adapter answered: no GPU, and no software Vulkan such as lavapipe.
    #[error("{0}")]
    NoAdapter(#[from] wgpu::RequestAdapterError),
    /// The adapter gave no device.
    #[error("{0}")]
    NoDevice(#[from] wgpu::RequestDeviceError),
}

/// Opens the default adapter with its own limits, and timestamps if it has them. Blocks for up to some hundred milliseconds. Not for the web, where a device must be awaited.
pub fn open() -> Result<Headless, HeadlessError> {
    if wgpu::Instance::enabled_backend_features().is_empty() {
        return Err(HeadlessError::NoBackend);
    }
    let instance = wgpu::Instance::default();
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))?;
    let timestamps = wgpu::Features::TIMESTAMP_QUERY;
    let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
        label: Some("polpo headless"),
        required_limits: adapter.limits(),
        required_features: adapter.features() & timestamps,
        ..Default::default()
    }))?;
    Ok(Headless { device, queue, info: adapter.get_info() })
}
