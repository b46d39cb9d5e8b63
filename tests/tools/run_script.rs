//! `./run demo` and `./run tables` call cargo and our programs with arguments that they know.

use crate::support::cli::Folder;
use std::{
    env, fs,
    os::unix::fs::PermissionsExt,
    path::Path,
    process::{Command, Output},
};

/// A program that stands in for another one.
fn write_program(path: &Path, script: &str) {
    fs::create_dir_all(path.parent().expect("it is in a folder")).expect("the folder can be made");
    fs::write(path, format!("#!/usr/bin/env bash\n{script}\n")).expect("the file can be written");
    fs::set_permissions(path, fs::Permissions::from_mode(0o755)).expect("it may be run");
}

/// Runs the script where the workspace was built before, with a cargo that only checks its arguments.
fn run(name: &str, arguments: &[&str], display: &str) -> Output {
    let scratch = Folder::without_gpu(name);
    let folder = scratch.path("");
    let path = env::var_os("PATH").unwrap_or_default();
    let cargo = env::split_paths(&path).map(|folder| folder.join("cargo")).find(|cargo| cargo.is_file());
    let cargo = cargo.expect("cargo is in the path");
    // Cargo reports unknown arguments before it prints its help.
    write_program(
        &folder.join("bin/cargo"),
        &format!(
            "own=(); for a in \"$@\"; do [ \"$a\" = -- ] && break; own+=(\"$a\"); done; exec '{}' \"${{own[@]}}\" --help",
            cargo.display()
        ),
    );
    for program in ["debug/examples/lab", "debug/viewer"] {
        write_program(&folder.join(program), &format!("echo {program} $1; [[ \"$2\" != *ajar.glb || $1 = demo ]]"));
    }
    fs::create_dir_all(folder.join("debug/deps")).expect("the folder can be made");
    fs::write(folder.join("debug/deps/libbevy_egui-0.rlib"), "").expect("the file can be written");
    let path =
        env::join_paths([folder.join("bin")].into_iter().chain(env::split_paths(&path))).expect("the path is sound");
    Command::new(Path::new(env!("CARGO_MANIFEST_DIR")).join("../run"))
        .args(arguments)
        .env("PATH", path)
        .env("CARGO_TARGET_DIR", &folder)
        .env("VK_DRIVER_FILES", "some driver")
        .env("DISPLAY", display)
        .env_remove("WAYLAND_DISPLAY")
        .output()
        .expect("the script starts")
}

#[test]
fn the_demo_runs_its_programs() {
    for (name, display, programs) in [
        ("demo", "", &["debug/examples/lab demo"][..]),
        ("demo_display", ":0", &["debug/examples/lab demo", "debug/viewer assets/scenes/glossy.glb"]),
    ] {
        let output = run(name, &["demo"], display);
        let (out, errors) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        assert!(output.status.success(), "{name}: {out}{errors}");
        for program in programs {
            assert!(out.lines().any(|line| line == *program), "{name}: {program} did not run: {out}{errors}");
        }
    }
}

/// The stand-in for `lab` fails in one scene.
#[test]
fn tables_are_measured_by_the_commands_above_them() {
    let output = run("tables", &["tables", "presets assets/scenes/"], "");
    let (out, errors) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    let runs = out.lines().filter(|line| *line == "debug/examples/lab presets").count();
    assert_eq!(runs, 7, "the tables of docs/trade.md: {out}{errors}");
    assert!(!out.lines().any(|line| line == "debug/examples/lab frames"), "{out}");
    // A folder may hold half a sweep of another program.
    let commands: Vec<&str> = out.lines().filter(|line| line.starts_with('+') && line.contains(" presets ")).collect();
    assert!(commands.len() == 7 && commands.iter().all(|command| command.ends_with(" --fresh")), "{commands:?}");
    assert_eq!(output.status.code(), Some(1), "{out}{errors}");
    assert!(errors.contains("FAILED: lab presets assets/scenes/ajar.glb"), "{errors}");
}

/// Marks without a table hold the command that measures it.
#[test]
fn every_table_between_marks_has_a_command_and_the_others_are_named() {
    for command in ["bias", "motion"] {
        let output = run(&format!("tables_{command}"), &["tables", &format!("{command} ")], "");
        let (out, errors) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        assert!(out.lines().any(|line| line == format!("debug/examples/lab {command}")), "{out}{errors}");
        assert!(!out.contains("has no command"), "{out}");
        let (_, by_hand) = out.split_once("No command writes these tables of figures:").expect("they are listed");
        assert!(by_hand.contains("README.md:") && by_hand.contains("docs/experiments.md:"), "{by_hand}");
        // The figures of presets are between marks.
        assert!(!by_hand.contains("docs/trade.md"), "{by_hand}");
    }
}
