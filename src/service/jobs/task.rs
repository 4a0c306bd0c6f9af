//! The messages between a server and a worker about a problem: the task, and its result.
//!
//! Both are processes of one version of covis or of neighboring ones: fields keep their numbers. A
//! task names the files of its problem; their bytes travel beside the message.

use covis_solvers::io::colmap::ColmapEncoding;
#[cfg(feature = "cluster")]
use covis_solvers::price::Ceiling;
use prost::Message;
use serde_json::{Value, json};

#[cfg(feature = "cluster")]
use super::solving::SolvingOptions;
use super::solving::{Format, Solved, Task};
use crate::service::error::ServiceError;
use crate::wire::v1;

/// A task as a message.
#[derive(Clone, PartialEq, Message)]
struct TaskMessage {
    #[prost(string, tag = "1")]
    path: String,
    #[prost(uint32, tag = "2")]
    format: u32,
    #[prost(message, repeated, tag = "3")]
    files: Vec<v1::JobFile>,
    #[prost(bool, tag = "4")]
    keep: bool,
    #[prost(bool, tag = "5")]
    rebuild: bool,
    #[prost(uint64, optional, tag = "6")]
    ceiling_bytes: Option<u64>,
    #[prost(double, optional, tag = "7")]
    ceiling_flops: Option<f64>,
}

/// A result as a message: a failure, or the rest.
#[derive(Clone, PartialEq, Message)]
struct ResultMessage {
    #[prost(message, optional, tag = "1")]
    failure: Option<v1::JobFailure>,
    #[prost(message, optional, tag = "2")]
    summary: Option<v1::SolveSummary>,
    #[prost(message, optional, tag = "3")]
    reconstruction: Option<v1::Reconstruction>,
    /// JSON with [`exact`] numbers.
    #[prost(bytes = "vec", tag = "4")]
    report: Vec<u8>,
    #[prost(message, repeated, tag = "5")]
    files: Vec<v1::FileChunk>,
}

/// The formats by their numbers.
const FORMATS: [(u32, Format); 4] = [
    (1, Format::Bal),
    (2, Format::Graph),
    (3, Format::Colmap(ColmapEncoding::Text)),
    (4, Format::Colmap(ColmapEncoding::Binary)),
];

/// A task for a worker.
pub(super) fn encode_task(task: &Task) -> Vec<u8> {
    let Task { path, format, files, options, ceiling } = task;
    let number = FORMATS.iter().find(|(_, known)| known == format).map_or(0, |(n, _)| *n);
    let file = |(path, size): &(String, u64)| v1::JobFile {
        path: path.clone(),
        size_bytes: i64::try_from(*size).unwrap_or(i64::MAX),
    };
    let message = TaskMessage {
        path: path.clone(),
        format: number,
        files: files.iter().map(file).collect(),
        keep: options.keep,
        rebuild: options.rebuild,
        ceiling_bytes: ceiling.bytes,
        ceiling_flops: ceiling.flops_per_iteration,
    };
    message.encode_to_vec()
}

/// The task of a server; `None` where it is none that is known here.
#[cfg(feature = "cluster")]
pub(super) fn decode_task(bytes: &[u8]) -> Option<Task> {
    let message = TaskMessage::decode(bytes).ok()?;
    let (_, format) = FORMATS.into_iter().find(|(number, _)| *number == message.format)?;
    let size = |file: v1::JobFile| (file.path, u64::try_from(file.size_bytes).unwrap_or(0));
    let (bytes, flops_per_iteration) = (message.ceiling_bytes, message.ceiling_flops);
    Some(Task {
        path: message.path,
        format,
        files: message.files.into_iter().map(size).collect(),
        options: SolvingOptions { keep: message.keep, rebuild: message.rebuild },
        ceiling: Ceiling { bytes, flops_per_iteration },
    })
}

/// What a worker hands in: what it found, or why the task fails.
#[cfg(feature = "cluster")]
pub(super) fn encode_result(result: Result<Solved, v1::JobFailure>) -> Vec<u8> {
    let message = match result {
        Err(failure) => ResultMessage { failure: Some(failure), ..ResultMessage::default() },
        Ok(Solved { summary, reconstruction, report, files, held: _ }) => ResultMessage {
            failure: None,
            summary: Some(summary),
            reconstruction,
            report: serde_json::to_vec(&exact(report)).unwrap_or_default(),
            files: files
                .into_iter()
                .map(|(path, data)| v1::FileChunk { path, data, ..v1::FileChunk::default() })
                .collect(),
        },
    };
    message.encode_to_vec()
}

/// What a worker handed in.
///
/// # Errors
/// The failure of the task, and [`ServiceError::OfWorker`] where the result cannot be read.
pub(super) fn decode_result(bytes: &[u8]) -> Result<Solved, ServiceError> {
    let unreadable = || {
        let message = "the result of a worker cannot be read".to_owned();
        let (code, reason) = (tonic::Code::Internal as i32, "WORKER_FAILED".to_owned());
        ServiceError::OfWorker(v1::JobFailure { code, message, reason })
    };
    let message = ResultMessage::decode(bytes).map_err(|_error| unreadable())?;
    if let Some(failure) = message.failure {
        return Err(ServiceError::OfWorker(failure));
    }
    Ok(Solved {
        summary: message.summary.ok_or_else(unreadable)?,
        reconstruction: message.reconstruction,
        report: serde_json::from_slice(&message.report)
            .map(number)
            .map_err(|_error| unreadable())?,
        files: message.files.into_iter().map(|file| (file.path, file.data)).collect(),
        held: None,
    })
}

/// Marks the bits of a floating-point number.
const BITS: &str = "f64 bits";

/// A document whose floating-point numbers are their bits: one that is read from JSON's digits may differ
/// in the last bit.
#[cfg(any(test, feature = "cluster"))]
fn exact(value: Value) -> Value {
    match value {
        Value::Number(number) if number.is_f64() => {
            json!({ BITS: number.as_f64().map(f64::to_bits) })
        }
        Value::Array(values) => values.into_iter().map(exact).collect(),
        Value::Object(entries) => entries.into_iter().map(|(key, v)| (key, exact(v))).collect(),
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => value,
    }
}

/// The document of one with [`exact`] numbers.
fn number(value: Value) -> Value {
    if let Some(bits) = value.get(BITS).and_then(Value::as_u64) {
        return json!(f64::from_bits(bits));
    }
    match value {
        Value::Array(values) => values.into_iter().map(number).collect(),
        Value::Object(entries) => entries.into_iter().map(|(key, v)| (key, number(v))).collect(),
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => value,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_a_report_arrive_bit_by_bit() {
        let numbers: Vec<f64> = (1..2_000).map(|k| f64::from(k).sqrt() * 1e-7).collect();
        let report = json!({ "rows": [{ "cost": numbers }], "count": 3, "none": null, "is": true });
        let sent = serde_json::to_vec(&exact(report.clone())).unwrap();
        assert_eq!(number(serde_json::from_slice(&sent).unwrap()), report);
    }
}
