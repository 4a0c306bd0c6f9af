//! `docs/wire-reference.md` is what the comments of `proto/covis/v1` say, as a page.
//!
//! `COVIS_TEST_REGENERATE=1 cargo test --test integration generated` writes it, with the code.

use std::fmt::Write as _;
use std::path::Path;

use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, EnumDescriptorProto, FieldDescriptorProto, FileDescriptorProto,
    ServiceDescriptorProto,
};

use crate::generated::compiler;

const PAGE: &str = "docs/wire-reference.md";
const FOLDER: &str = "proto/covis/v1";

/// Numbers of fields in the descriptors of files, messages, enums and services, by which comments are
/// found (`descriptor.proto`).
const MESSAGE: i32 = 4;
const ENUM: i32 = 5;
const SERVICE: i32 = 6;
const PART: i32 = 2;
const ONEOF: i32 = 8;
const SYNTAX: i32 = 12;

#[test]
fn the_generated_reference_of_the_wire_is_that_of_the_protos() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = page(&compiler(root, FOLDER).file_descriptor_set().file);
    let path = root.join(PAGE);
    if std::env::var_os("COVIS_TEST_REGENERATE").is_some() {
        fs_err::write(&path, &page).unwrap();
    }
    let present = fs_err::read_to_string(&path).unwrap_or_default();
    assert!(present == page, "{PAGE} is not of the protos as they are; see this file's head");
}

/// The whole page.
fn page(files: &[FileDescriptorProto]) -> String {
    let mut out = format!(
        "# Wire reference\n\n\
         What the comments of `{FOLDER}` say, generated from them. [The wire](wire.md) tells how the\n\
         calls work together; [Conventions](conventions.md) has frames, units and residuals.\n"
    );
    let own: Vec<_> = files.iter().filter(|file| file.package() == "covis.v1").collect();
    for file in own {
        let name = file.name().rsplit('/').next().unwrap();
        let comments = Comments(file);
        writeln!(out, "\n## {name}\n\n{}", comments.at_head()).unwrap();
        for (index, service) in (0..).zip(&file.service) {
            write_service(&mut out, service, &comments, &[SERVICE, index]);
        }
        for (index, message) in (0..).zip(&file.message_type) {
            assert!(
                message.nested_type.is_empty(),
                "nested messages have no place in the page yet"
            );
            write_message(&mut out, message, &comments, &[MESSAGE, index]);
        }
        for (index, one) in (0..).zip(&file.enum_type) {
            write_enum(&mut out, one, &comments, &[ENUM, index]);
        }
    }
    out
}

/// The comments of a file, by the place of what they are about.
struct Comments<'a>(&'a FileDescriptorProto);

impl Comments<'_> {
    fn locations(&self) -> &[prost_types::source_code_info::Location] {
        self.0.source_code_info.as_ref().map_or(&[], |info| &info.location)
    }

    /// What stands above an element, as Markdown.
    fn at(&self, path: &[i32]) -> String {
        let found = self.locations().iter().find(|location| location.path == path);
        let text = found.map_or("", |location| location.leading_comments());
        markdown(text)
    }

    /// The same in one line, for a cell of a table.
    fn in_cell(&self, path: &[i32]) -> String {
        self.at(path).replace('\n', " ").replace('|', "\\|")
    }

    /// What the file says at its head, above `syntax`.
    fn at_head(&self) -> String {
        let syntax = self.locations().iter().find(|location| location.path == [SYNTAX]);
        let detached = syntax.into_iter().flat_map(|location| &location.leading_detached_comments);
        let parts: Vec<String> = detached.map(|text| markdown(text)).collect();
        parts.join("\n\n")
    }
}

/// A comment as Markdown: what would be markup there is escaped, lists stay lists.
fn markdown(comment: &str) -> String {
    let mut out = String::new();
    for line in comment.lines() {
        let line = line.strip_prefix(' ').unwrap_or(line).trim_end();
        for c in line.chars() {
            if "*`<>[]\\".contains(c) {
                out.push('\\');
            }
            out.push(c);
        }
        out.push('\n');
    }
    out.trim_end().to_owned()
}

fn write_service(
    out: &mut String,
    service: &ServiceDescriptorProto,
    comments: &Comments<'_>,
    at: &[i32],
) {
    writeln!(out, "\n### {}\n\n{}", service.name(), comments.at(at)).unwrap();
    for (index, method) in (0..).zip(&service.method) {
        let side = |streams: bool, name: &str| {
            format!("{}{}", if streams { "stream " } else { "" }, link(name))
        };
        let takes = side(method.client_streaming(), method.input_type());
        let answers = side(method.server_streaming(), method.output_type());
        let comment = comments.at(&[at, &[PART, index]].concat());
        writeln!(out, "\n#### {}\n\n{takes} → {answers}\n\n{comment}", method.name()).unwrap();
    }
}

fn write_message(out: &mut String, message: &DescriptorProto, comments: &Comments<'_>, at: &[i32]) {
    writeln!(out, "\n### {}\n\n{}", message.name(), comments.at(at)).unwrap();
    if message.field.is_empty() {
        return;
    }
    out.push_str("\n| | field | type | |\n|---|---|---|---|\n");
    let mut last_oneof = None;
    for (index, field) in (0..).zip(&message.field) {
        // A field that is `optional` lies in a oneof of its own, which nobody wrote.
        let oneof = field.oneof_index.filter(|_| !field.proto3_optional());
        if let Some(which) = oneof.filter(|_| oneof != last_oneof) {
            let name = message.oneof_decl[usize::try_from(which).unwrap()].name();
            let comment = comments.in_cell(&[at, &[ONEOF, which]].concat());
            writeln!(out, "| | one of *{name}* | | {comment} |").unwrap();
        }
        last_oneof = oneof;
        let comment = comments.in_cell(&[at, &[PART, index]].concat());
        writeln!(
            out,
            "| {} | `{}` | {} | {comment} |",
            field.number(),
            field.name(),
            type_of(field)
        )
        .unwrap();
    }
}

fn write_enum(out: &mut String, one: &EnumDescriptorProto, comments: &Comments<'_>, at: &[i32]) {
    writeln!(out, "\n### {}\n\n{}", one.name(), comments.at(at)).unwrap();
    out.push_str("\n| | value | |\n|---|---|---|\n");
    for (index, value) in (0..).zip(&one.value) {
        let comment = comments.in_cell(&[at, &[PART, index]].concat());
        writeln!(out, "| {} | `{}` | {comment} |", value.number(), value.name()).unwrap();
    }
}

/// A field's type, with what it may be absent or repeated.
fn type_of(field: &FieldDescriptorProto) -> String {
    let kind = field.r#type();
    let name = if matches!(kind, Type::Message | Type::Enum) {
        link(field.type_name())
    } else {
        kind.as_str_name().trim_start_matches("TYPE_").to_lowercase()
    };
    if field.label() == Label::Repeated {
        format!("repeated {name}")
    } else if field.proto3_optional() {
        format!("optional {name}")
    } else {
        name
    }
}

/// The name of a message or enum, which leads to its place on the page where it is ours.
fn link(full_name: &str) -> String {
    let full_name = full_name.trim_start_matches('.');
    full_name
        .strip_prefix("covis.v1.")
        .map_or_else(|| full_name.to_owned(), |name| format!("[{name}](#{})", name.to_lowercase()))
}
