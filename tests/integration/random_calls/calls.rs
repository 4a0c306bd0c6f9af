//! Calls of any method with messages as bytes: every method is called as a stream in both directions, which
//! HTTP/2 does not tell from a unary call.

use bytes::{Buf, BufMut};
use protox::prost_reflect::{DynamicMessage, MethodDescriptor, ReflectMessage, Value};
use tonic::codec::{Codec, DecodeBuf, Decoder, EncodeBuf, Encoder};
use tonic::transport::Channel;
use tonic::{Code, Request, Status};

/// Answers of a stream that are read; one that follows a map does not end.
const MOST_ANSWERS: usize = 500;

/// Messages as bytes.
#[derive(Clone, Copy, Default)]
struct Raw;

impl Codec for Raw {
    type Encode = Vec<u8>;
    type Decode = Vec<u8>;
    type Encoder = Self;
    type Decoder = Self;

    fn encoder(&mut self) -> Self {
        *self
    }

    fn decoder(&mut self) -> Self {
        *self
    }
}

impl Encoder for Raw {
    type Item = Vec<u8>;
    type Error = Status;

    fn encode(&mut self, item: Vec<u8>, to: &mut EncodeBuf<'_>) -> Result<(), Status> {
        to.put_slice(&item);
        Ok(())
    }
}

impl Decoder for Raw {
    type Item = Vec<u8>;
    type Error = Status;

    fn decode(&mut self, from: &mut DecodeBuf<'_>) -> Result<Option<Vec<u8>>, Status> {
        Ok(Some(from.copy_to_bytes(from.remaining()).to_vec()))
    }
}

/// What a call came to.
pub(super) struct Answer {
    pub(super) status: Status,
    pub(super) messages: Vec<DynamicMessage>,
}

impl Answer {
    /// Codes that only a bug has.
    pub(super) fn is_bug(&self) -> bool {
        matches!(self.status.code(), Code::Internal | Code::Unknown | Code::DataLoss)
    }

    /// A number of an answer that is not finite, by the path of its field.
    pub(super) fn not_finite(&self) -> Option<String> {
        self.messages.iter().find_map(|message| not_finite(message, message.descriptor().name()))
    }
}

/// Calls a method, with a deadline in milliseconds.
pub(super) async fn call(
    channel: &Channel,
    method: &MethodDescriptor,
    requests: &[DynamicMessage],
    deadline_ms: u32,
) -> Answer {
    let path = format!("/{}/{}", method.parent_service().full_name(), method.name());
    let requests: Vec<_> = requests.iter().map(prost::Message::encode_to_vec).collect();
    let mut request = Request::new(tokio_stream::iter(requests));
    // As a header alone: the client would end the call by itself.
    let deadline = format!("{deadline_ms}m").parse().unwrap();
    request.metadata_mut().insert("grpc-timeout", deadline);
    let mut messages = Vec::new();
    let status = match read(channel, path, request, method, &mut messages).await {
        Ok(()) => Status::ok(""),
        Err(status) => status,
    };
    Answer { status, messages }
}

async fn read(
    channel: &Channel,
    path: String,
    request: Request<impl tokio_stream::Stream<Item = Vec<u8>> + Send + 'static>,
    method: &MethodDescriptor,
    messages: &mut Vec<DynamicMessage>,
) -> Result<(), Status> {
    let mut client = tonic::client::Grpc::new(channel.clone()).max_decoding_message_size(64 << 20);
    let ready = client.ready().await;
    ready.map_err(|error| Status::unavailable(error.to_string()))?;
    let path = path.parse().unwrap();
    let mut answers = client.streaming(request, path, Raw).await?.into_inner();
    // What follows a map or a job goes on; its first state is enough.
    let most = if method.name().starts_with("Watch") { 1 } else { MOST_ANSWERS };
    while messages.len() < most
        && let Some(bytes) = answers.message().await?
    {
        messages.push(DynamicMessage::decode(method.output(), bytes.as_slice()).unwrap());
    }
    Ok(())
}

/// The fields of a message that are set, in short.
pub(super) fn show(message: &DynamicMessage) -> String {
    let fields =
        message.fields().map(|(field, value)| format!("{}: {}", field.name(), text(value)));
    format!("{{{}}}", fields.collect::<Vec<_>>().join(", "))
}

fn text(value: &Value) -> String {
    if let Some(message) = value.as_message() {
        show(message)
    } else if let Some(list) = value.as_list() {
        format!("[{}]", list.iter().map(text).collect::<Vec<_>>().join(", "))
    } else if let Some(bytes) = value.as_bytes() {
        format!("{:?}", String::from_utf8_lossy(bytes))
    } else {
        format!("{value:?}")
    }
}

fn not_finite(message: &DynamicMessage, path: &str) -> Option<String> {
    // A solve says so of its costs, and an evaluation of its errors, where a problem is beyond what
    // numbers hold.
    let of = ["SolveSummary", "IterationSummary", "EvaluateTrajectoryResult"];
    if of.contains(&message.descriptor().name()) {
        return None;
    }
    message
        .fields()
        .find_map(|(field, value)| not_finite_value(value, &format!("{path}.{}", field.name())))
}

fn not_finite_value(value: &Value, path: &str) -> Option<String> {
    if let Some(message) = value.as_message() {
        not_finite(message, path)
    } else if let Some(list) = value.as_list() {
        list.iter().find_map(|value| not_finite_value(value, path))
    } else {
        let number = value.as_f64().or(value.as_f32().map(f64::from));
        number.filter(|number| !number.is_finite()).map(|number| format!("{path} is {number}"))
    }
}
