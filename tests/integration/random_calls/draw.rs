//! Random values of the types that the wire has: numbers at the ends of their ranges, ids that do not
//! exist, texts that no name may have. A seed decides all of them.

use protox::prost_reflect::{
    DynamicMessage, FieldDescriptor, Kind, MessageDescriptor, ReflectMessage, Value,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Numbers at which arithmetic overflows, underflows or loses all digits, and some usual ones.
const NUMBERS: [f64; 26] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    std::f64::consts::PI,
    100.0,
    -1e3,
    1e9,
    -1e30,
    1e75,
    1e100,
    -1e150,
    1.4e154,
    1e155,
    1e300,
    1.797e308,
    -1.797e308,
    1e-9,
    1e-30,
    1e-154,
    1e-308,
    5e-324,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::NAN,
];
const INTEGERS: [i64; 14] = [
    0,
    1,
    2,
    3,
    7,
    -1,
    100,
    65_536,
    i32::MAX as i64,
    1 << 53,
    1 << 62,
    (1 << 62) + 1,
    i64::MAX,
    i64::MIN,
];
const TEXTS: [&str; 9] = [
    "",
    "house",
    "robot",
    "no\0thing",
    "\u{7f}\u{1b}[2J\r\n",
    "../../house",
    "a.b/c",
    "höhle",
    "\u{202e}x",
];
/// A text of this length is longer than any name may be.
const LONG: usize = 5000;
/// How deep a random message is.
const DEPTH: u32 = 5;

/// The source of all values of a run.
pub(super) struct Draw(ChaCha8Rng);

impl Draw {
    pub(super) fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    pub(super) fn below(&mut self, count: usize) -> usize {
        self.0.random_range(0..count)
    }

    pub(super) fn chance(&mut self, probability: f64) -> bool {
        self.0.random_bool(probability)
    }

    pub(super) fn one<T: Clone>(&mut self, of: &[T]) -> T {
        of[self.below(of.len())].clone()
    }

    pub(super) fn number(&mut self) -> f64 {
        self.one(&NUMBERS)
    }

    /// A number that passes as finite.
    pub(super) fn finite(&mut self) -> f64 {
        loop {
            let number = self.number();
            if number.is_finite() {
                return number;
            }
        }
    }

    /// A unit quaternion: none, half a turn, or any.
    pub(super) fn rotation(&mut self) -> [f64; 4] {
        if self.chance(0.5) {
            let turns = [[0.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, -1.0]];
            return self.one(&turns);
        }
        let any = [(); 4].map(|()| self.0.random_range(-1.0..1.0_f64));
        let norm = any.iter().map(|x| x * x).sum::<f64>().sqrt();
        any.map(|x| x / norm)
    }

    /// The upper triangle of an information matrix or a covariance: definite of any scale, singular, or any.
    pub(super) fn triangle(&mut self, size: usize) -> Vec<f64> {
        let (kind, scale, other) = (self.below(5), self.finite().abs(), self.finite().abs());
        let mut triangle = Vec::new();
        for row in 0..size {
            for column in row..size {
                triangle.push(match (kind, row == column) {
                    (0, true) => scale,
                    // Some directions are measured, others are not.
                    (1, true) => [scale, 0.0][row % 2],
                    (2, true) => [scale, other][row % 2],
                    (0..=2, false) => 0.0,
                    // Of rank one.
                    (3, _) => scale,
                    _ => self.number(),
                });
            }
        }
        triangle
    }

    fn integer(&mut self) -> i64 {
        self.one(&INTEGERS)
    }

    fn text(&mut self) -> String {
        if self.chance(0.1) { "x".repeat(LONG) } else { self.one(&TEXTS).to_owned() }
    }

    /// A message of random fields.
    pub(super) fn message(&mut self, of: &MessageDescriptor, depth: u32) -> DynamicMessage {
        let mut message = DynamicMessage::new(of.clone());
        for field in of.fields() {
            if depth < DEPTH && self.chance(0.6) {
                let value = self.field(&field, depth);
                message.set_field(&field, value);
            }
        }
        message
    }

    fn field(&mut self, field: &FieldDescriptor, depth: u32) -> Value {
        if !field.is_list() {
            return self.value(field, depth);
        }
        let size = match field.parent_message().name() {
            "InformationMatrix3" | "Covariance3" => 3,
            "InformationMatrix6" | "Covariance6" => 6,
            _ => {
                return Value::List((0..self.below(4)).map(|_| self.value(field, depth)).collect());
            }
        };
        Value::List(self.triangle(size).into_iter().map(Value::F64).collect())
    }

    fn value(&mut self, field: &FieldDescriptor, depth: u32) -> Value {
        match field.kind() {
            Kind::Double => Value::F64(self.number()),
            Kind::Float => Value::F32(self.number() as f32),
            Kind::Int64 | Kind::Sint64 | Kind::Sfixed64 => Value::I64(self.integer()),
            Kind::Int32 | Kind::Sint32 | Kind::Sfixed32 => Value::I32(self.integer() as i32),
            Kind::Uint64 | Kind::Fixed64 => Value::U64(self.integer() as u64),
            Kind::Uint32 | Kind::Fixed32 => Value::U32(self.integer() as u32),
            Kind::Bool => Value::Bool(self.chance(0.5)),
            Kind::String => Value::String(self.text()),
            Kind::Bytes => {
                let length = self.one(&[0, 1, 4, 32, 256, LONG]);
                Value::Bytes((0..length).map(|_| self.0.random::<u8>()).collect())
            }
            // Also numbers that no version knows.
            Kind::Enum(of) => Value::EnumNumber(self.below(of.values().len() + 2) as i32),
            Kind::Message(of) => Value::Message(self.message(&of, depth + 1)),
        }
    }

    /// Changes one value somewhere in a message.
    pub(super) fn change(&mut self, message: &mut DynamicMessage) {
        if message.descriptor().name() == "RigidTransform" && self.chance(0.7) {
            return self.move_far(message);
        }
        let fields: Vec<_> = message.descriptor().fields().collect();
        let set: Vec<_> = fields.iter().filter(|field| message.has_field(field)).cloned().collect();
        // Mostly what is there: a message that is made anew is refused early.
        let among = if set.is_empty() || self.chance(0.1) { &fields } else { &set };
        if among.is_empty() {
            return;
        }
        let field = self.one(among);
        let (keeps, is_set) = (self.chance(0.9), message.has_field(&field));
        if is_set && keeps {
            let value = message.get_field_mut(&field);
            if let Some(inner) = value.as_message_mut() {
                return self.change(inner);
            }
            if let Some(list) = value.as_list_mut()
                && !list.is_empty()
                && !is_triangle(&field)
            {
                return self.change_list(&field, list);
            }
        }
        match self.chance(0.05) {
            true => message.clear_field(&field),
            false => {
                let value = self.field(&field, 1);
                message.set_field(&field, value);
            }
        }
    }

    fn change_list(&mut self, field: &FieldDescriptor, list: &mut Vec<Value>) {
        let at = self.below(list.len());
        match self.below(8) {
            0 => drop(list.remove(at)),
            1 => list.push(list[at].clone()),
            _ => match list[at].as_message_mut() {
                Some(inner) => self.change(inner),
                None => list[at] = self.value(field, 1),
            },
        }
    }

    /// A rigid motion that passes every check of its form.
    fn move_far(&mut self, transform: &mut DynamicMessage) {
        let translation = [(); 3].map(|()| self.finite());
        let rotation = self.rotation();
        let parts: [(&str, &[f64]); 2] = [("translation", &translation), ("rotation", &rotation)];
        for (name, numbers) in parts {
            let Some(field) = transform.descriptor().get_field_by_name(name) else { continue };
            let Kind::Message(of) = field.kind() else { continue };
            let mut part = DynamicMessage::new(of.clone());
            for (field, &number) in of.fields().zip(numbers) {
                part.set_field(&field, Value::F64(number));
            }
            transform.set_field(&field, Value::Message(part));
        }
    }
}

fn is_triangle(field: &FieldDescriptor) -> bool {
    field.name() == "upper_triangle"
}
