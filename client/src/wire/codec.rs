//! How messages become bytes and back: prost's codec, which decodes nothing that would take far more
//! memory than it has bytes (`crate::decoding`). The code is OUT_OF_RANGE, as of one that is too long.

use std::marker::PhantomData;
use std::sync::LazyLock;

use prost::bytes::Buf as _;
use prost::{Message, Name};
use tonic::Status;
use tonic::codec::{self, BufferSettings, DecodeBuf};
use tonic_prost::{ProstCodec, ProstDecoder, ProstEncoder};

use crate::decoding::Shapes;

static SHAPES: LazyLock<Shapes> = LazyLock::new(|| Shapes::of(super::v1::FILE_DESCRIPTOR_SET));

/// The codec of every call: encodes `T`, decodes `U`.
#[derive(Debug)]
pub struct Codec<T, U>(PhantomData<(T, U)>);

impl<T, U> Default for Codec<T, U> {
    fn default() -> Self {
        Self(PhantomData)
    }
}

impl<T, U> codec::Codec for Codec<T, U>
where
    T: Message + Send + 'static,
    U: Message + Default + Name + Send + 'static,
{
    type Encode = T;
    type Decode = U;
    type Encoder = ProstEncoder<T>;
    type Decoder = Decoder<U>;

    fn encoder(&mut self) -> Self::Encoder {
        ProstCodec::<T, U>::raw_encoder(BufferSettings::default())
    }

    fn decoder(&mut self) -> Self::Decoder {
        Decoder(ProstCodec::<T, U>::raw_decoder(BufferSettings::default()))
    }
}

/// Decodes messages whose bytes are worth their memory.
#[derive(Debug)]
pub struct Decoder<U>(ProstDecoder<U>);

impl<U: Message + Default + Name> codec::Decoder for Decoder<U> {
    type Item = U;
    type Error = Status;

    fn decode(&mut self, source: &mut DecodeBuf<'_>) -> Result<Option<U>, Status> {
        // A message is one piece.
        check::<U>(source.chunk())?;
        self.0.decode(source)
    }

    fn buffer_settings(&self) -> BufferSettings {
        self.0.buffer_settings()
    }
}

/// What takes the most memory of the messages of a name; see [`Shapes::densest`].
#[cfg(any(test, feature = "fuzzing"))]
pub fn densest<M: Name>(length: usize) -> Vec<Vec<u8>> {
    SHAPES.densest(&M::full_name(), length)
}

/// Refuses a message that would take far more memory than it has bytes.
pub fn check<M: Name>(bytes: &[u8]) -> Result<(), Status> {
    let refused = |error| Status::out_of_range(format!("the message is refused: {error}"));
    SHAPES.check(&M::full_name(), bytes).map_err(refused)
}
