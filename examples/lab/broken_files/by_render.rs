//! Loads copies by the program `render`, in a process of its own for each of them.

use bevy_restir_support::exr_file;
use std::{
    fs::{self, File},
    path::{Path, PathBuf},
    process::{Child, Command, ExitStatus, Stdio},
    thread,
    time::{Duration, Instant},
};

use super::{LIGHT, Outcome, Subject};

/// A process may take this long: it compiles shaders, and other programs may keep the machine busy.
const PATIENCE: Duration = Duration::from_secs(240);
/// Time between two looks at a process.
const PAUSE: Duration = Duration::from_millis(20);

/// The program, and where it writes.
pub struct Render {
    program: PathBuf,
    picture: PathBuf,
    messages: PathBuf,
    subject: Subject,
}

impl Render {
    /// Fails if the program was not built beside this one.
    pub fn new(folder: &Path, subject: Subject) -> Result<Self, String> {
        let lab = std::env::current_exe().map_err(|e| e.to_string())?;
        let program = lab.with_file_name("render").with_extension(std::env::consts::EXE_EXTENSION);
        if !program.is_file() {
            return Err(format!("{} is missing: `cargo build --examples` makes it", program.display()));
        }
        Ok(Self { program, picture: folder.join("render.exr"), messages: folder.join("render.txt"), subject })
    }

    /// Renders a file; an error if the program cannot be run.
    pub fn load(&self, path: &Path) -> Result<Outcome, String> {
        let of_messages = |e: std::io::Error| format!("{}: {e}", self.messages.display());
        // A pipe that nobody reads would stop a program with many warnings.
        let messages = File::create(&self.messages).map_err(of_messages)?;
        let mut child = Command::new(&self.program)
            .arg(path)
            .arg("--out")
            .arg(&self.picture)
            .args(self.options())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(messages)
            .spawn()
            .map_err(|e| format!("{}: {e}", self.program.display()))?;
        let status = wait(&mut child).map_err(|e| e.to_string())?;
        let text = String::from_utf8_lossy(&fs::read(&self.messages).map_err(of_messages)?).into_owned();
        let outcome = self.outcome(status, &text);
        for file in [&self.messages, &self.picture] {
            let _ = fs::remove_file(file);
        }
        Ok(outcome)
    }

    /// The same size, technique and light as in the app.
    fn options(&self) -> Vec<String> {
        let Subject { technique, size } = self.subject;
        let settings = self.subject.settings();
        let (technique, bounces) = (format!("{technique:?}").to_lowercase(), settings.bounces);
        let size = format!("{}x{}", size.x, size.y);
        let options = [
            ("technique", technique),
            ("preset", "performance".into()),
            ("bounces", bounces.to_string()),
            ("size", size),
            ("frames", "1".into()),
            ("warmup", "0".into()),
            ("env", format!("{LIGHT},{LIGHT},{LIGHT}")),
        ];
        options.into_iter().flat_map(|(name, value)| [format!("--{name}"), value]).collect()
    }

    /// What the end of a process means: `None` if it was stopped, because it took too long.
    fn outcome(&self, status: Option<ExitStatus>, messages: &str) -> Outcome {
        let Some(status) = status else {
            return Outcome::Fault(format!("render takes longer than {} s", PATIENCE.as_secs()));
        };
        let errors: Vec<&str> = messages.lines().filter(|line| line.starts_with("error: ")).collect();
        match (status.code(), &errors[..]) {
            (Some(0), []) => match exr_file::read(&self.picture) {
                Ok((_, pixels)) => Outcome::of_picture(pixels.into_iter().map(|[r, g, b, _]| [r, g, b])),
                Err(error) => Outcome::Fault(format!("render succeeds without a picture: {error}")),
            },
            (Some(1), [error]) => Outcome::of_error((*error).into()),
            _ => {
                let last = messages.lines().next_back().unwrap_or_default();
                Outcome::Fault(format!("render ends by {status} with {} lines of errors: {last}", errors.len()))
            }
        }
    }
}

/// Waits for the end of a process; stops it and returns `None` if it takes too long.
fn wait(child: &mut Child) -> std::io::Result<Option<ExitStatus>> {
    let start = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        if start.elapsed() > PATIENCE {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        thread::sleep(PAUSE);
    }
}
