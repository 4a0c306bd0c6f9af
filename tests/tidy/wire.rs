//! The proto files: every element has its comment, and the package is where its name says.

use crate::report;
use crate::source::{File, files};

fn protos() -> Vec<File> {
    files().into_iter().filter(|f| f.extension() == "proto").collect()
}

/// Whether a line declares something that a reader must be told about.
fn declares(line: &str) -> bool {
    let first = line.split([' ', '(']).next().unwrap_or(line);
    match first {
        "message" | "enum" | "service" | "rpc" | "oneof" => true,
        "syntax" | "package" | "import" | "option" | "reserved" | "returns" | "extensions" => false,
        // A field or an enum value; what stands in brackets behind the number does not matter.
        _ => line.split_once(" = ").is_some_and(|(name, number)| {
            let digits: String = number.chars().take_while(char::is_ascii_digit).collect();
            let named = name.chars().all(|c| c.is_alphanumeric() || "_ .<>,".contains(c));
            named && !digits.is_empty()
        }),
    }
}

#[test]
fn every_element_of_the_wire_has_its_comment() {
    let mut offenders = Vec::new();
    for file in protos() {
        let mut commented = false;
        for (number, line) in file.text.lines().enumerate() {
            let line = line.trim();
            if declares(line) && !commented && !line.contains("//") {
                offenders.push(format!("{}:{}: {line}", file.path, number + 1));
            }
            commented = line.starts_with("//");
        }
        if !file.text.starts_with("//") {
            offenders.push(format!("{}: does not say at its head what it is", file.path));
        }
    }
    report("Every message, field, value, service and RPC has a comment.", &offenders);
}

#[test]
fn every_rpc_has_its_own_messages() {
    let mut offenders = Vec::new();
    for file in protos() {
        let joined = file.text.replace('\n', " ");
        for rest in joined.split(" rpc ").skip(1) {
            let name = rest.split('(').next().unwrap_or("").trim();
            let messages = rest.split([';', '{']).next().unwrap_or("");
            let is_comment = !name.chars().all(|c| c.is_ascii_alphanumeric());
            let own = [format!("{name}Request)"), format!("{name}Response)")];
            if !is_comment && !own.iter().all(|message| messages.contains(message)) {
                offenders.push(format!("{}: rpc {name}", file.path));
            }
        }
    }
    report("Every RPC has an XRequest and an XResponse of its own.", &offenders);
}

#[test]
fn the_package_is_where_its_name_says() {
    let mut offenders = Vec::new();
    for file in protos() {
        let package = file.text.lines().find_map(|line| line.strip_prefix("package "));
        let package = package.unwrap_or("").trim_end_matches(';').replace('.', "/");
        if !file.path.starts_with(&format!("proto/{package}/")) {
            offenders.push(format!("{}: package {package}", file.path));
        }
        for service in file.text.lines().filter_map(|line| line.strip_prefix("service ")) {
            if !service.trim_end_matches([' ', '{']).ends_with("Service") {
                offenders.push(format!("{}: service {service}", file.path));
            }
        }
    }
    report("Folders follow the package, services end in Service.", &offenders);
}
