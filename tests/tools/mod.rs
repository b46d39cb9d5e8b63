//! The example programs as scripts call them.

mod features;
mod lab_cli;
mod lab_tables;
mod ray_queries;
mod render_aovs;
mod render_cli;
mod render_moments;
mod robustness;
#[cfg(unix)]
mod run_script;
mod sweep;
