//! Volumetric stiffness fields from joint angles and joint torques.

pub use vsf_contact as contact;
pub use vsf_core as core;
pub use vsf_data as data;
pub use vsf_filter as filter;
pub use vsf_pipeline as pipeline;
pub use vsf_plot as plot;
pub use vsf_robots as robots;
