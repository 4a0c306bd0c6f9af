//! The descriptors of the wire against a snapshot: a breaking change fails without any tool.
//!
//! One line a field (message, number, name, type, label), enum value or RPC. A line that is missing
//! or changed is a break; a new one is allowed and asks for an update with
//! `COVIS_TEST_UPDATE_SNAPSHOTS=1`.

use std::collections::BTreeSet;
use std::path::Path;

use covis::wire::v1::FILE_DESCRIPTOR_SET;
use prost::Message;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, EnumDescriptorProto, FieldDescriptorProto, FileDescriptorSet,
    ServiceDescriptorProto,
};

/// Describes a whole descriptor set, sorted.
fn describe(set: &FileDescriptorSet) -> BTreeSet<String> {
    let mut lines = BTreeSet::new();
    for file in set.file.iter().filter(|f| f.package().starts_with("covis.")) {
        for message in &file.message_type {
            describe_message(file.package(), message, &mut lines);
        }
        for enumeration in &file.enum_type {
            describe_enum(file.package(), enumeration, &mut lines);
        }
        for service in &file.service {
            describe_service(file.package(), service, &mut lines);
        }
    }
    lines
}

fn describe_message(scope: &str, message: &DescriptorProto, lines: &mut BTreeSet<String>) {
    let name = format!("{scope}.{}", message.name());
    lines.insert(format!("message {name}"));
    for field in &message.field {
        lines.insert(describe_field(&name, message, field));
    }
    for nested in &message.nested_type {
        describe_message(&name, nested, lines);
    }
    for enumeration in &message.enum_type {
        describe_enum(&name, enumeration, lines);
    }
}

fn describe_field(scope: &str, message: &DescriptorProto, field: &FieldDescriptorProto) -> String {
    let kind = if field.type_name().is_empty() {
        field.r#type().as_str_name().trim_start_matches("TYPE_").to_lowercase()
    } else {
        field.type_name().trim_start_matches('.').to_owned()
    };
    let label = match (field.label(), field.oneof_index, field.proto3_optional()) {
        (Label::Repeated, ..) => "repeated".to_owned(),
        (_, _, true) => "optional".to_owned(),
        (_, Some(index), false) => format!("oneof {}", message.oneof_decl[index as usize].name()),
        (_, None, false) => "singular".to_owned(),
    };
    format!("field {scope} {} {} {kind} {label}", field.number(), field.name())
}

fn describe_enum(scope: &str, enumeration: &EnumDescriptorProto, lines: &mut BTreeSet<String>) {
    for value in &enumeration.value {
        let name = enumeration.name();
        lines.insert(format!("enum {scope}.{name} {} {}", value.number(), value.name()));
    }
}

fn describe_service(scope: &str, service: &ServiceDescriptorProto, lines: &mut BTreeSet<String>) {
    for method in &service.method {
        let stream = |streams: bool| if streams { "stream " } else { "" };
        lines.insert(format!(
            "rpc {scope}.{}.{} {}{} -> {}{}",
            service.name(),
            method.name(),
            stream(method.client_streaming()),
            method.input_type().trim_start_matches('.'),
            stream(method.server_streaming()),
            method.output_type().trim_start_matches('.'),
        ));
    }
}

/// What differs, one sentence a line; empty when nothing does.
fn differences(snapshot: &BTreeSet<String>, now: &BTreeSet<String>) -> Vec<String> {
    let gone = snapshot.difference(now).map(|line| format!("BREAKING, gone or changed: {line}"));
    let new = now.difference(snapshot).map(|line| format!("new, not in the snapshot: {line}"));
    gone.chain(new).collect()
}

#[test]
fn the_wire_is_that_of_the_snapshot() {
    let now = describe(&FileDescriptorSet::decode(FILE_DESCRIPTOR_SET).unwrap());
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/snapshots/covis.v1.txt");
    if std::env::var_os("COVIS_TEST_UPDATE_SNAPSHOTS").is_some() {
        let text: String = now.iter().map(|line| format!("{line}\n")).collect();
        fs_err::create_dir_all(path.parent().unwrap()).unwrap();
        fs_err::write(&path, text).unwrap();
    }
    let text = fs_err::read_to_string(&path).unwrap();
    let snapshot: BTreeSet<String> = text.lines().map(str::to_owned).collect();
    let differences = differences(&snapshot, &now);
    assert!(
        differences.is_empty(),
        "{}\nset COVIS_TEST_UPDATE_SNAPSHOTS=1 to take what is not breaking",
        differences.join("\n")
    );
}

#[test]
fn a_changed_number_type_label_or_name_is_a_break() {
    let set = FileDescriptorSet::decode(FILE_DESCRIPTOR_SET).unwrap();
    let snapshot = describe(&set);
    type Edit = fn(&mut FieldDescriptorProto);
    let edits: [(Edit, &str); 4] = [
        (|f| f.number = Some(77), "field covis.v1.Vector3 1 x double singular"),
        (|f| f.set_type(Type::Float), "field covis.v1.Vector3 1 x double singular"),
        (|f| f.set_label(Label::Repeated), "field covis.v1.Vector3 1 x double singular"),
        (|f| f.name = Some("u".to_owned()), "field covis.v1.Vector3 1 x double singular"),
    ];
    for (edit, line) in edits {
        let mut changed = set.clone();
        let messages = changed.file.iter_mut().flat_map(|f| &mut f.message_type);
        let vector = messages.into_iter().find(|m| m.name() == "Vector3").unwrap();
        edit(&mut vector.field[0]);
        let found = differences(&snapshot, &describe(&changed));
        assert!(found.contains(&format!("BREAKING, gone or changed: {line}")), "{found:?}");
        assert_eq!(found.len(), 2, "the old line and the new one: {found:?}");
    }
}
