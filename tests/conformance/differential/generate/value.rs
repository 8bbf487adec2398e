//! Values and documents, made to collide: few names, few values of each type.

use bson::oid::ObjectId;
use bson::spec::BinarySubtype;
use bson::{Binary, Bson, DateTime, Decimal128, Document, Regex, Timestamp, doc};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use proptest::strategy::Union;

/// What makes a value.
pub(crate) type Gen<T = Bson> = BoxedStrategy<T>;

/// One of these.
pub(crate) fn pick<T: Into<Bson> + Clone>(values: &[T]) -> Gen {
    select(values.iter().cloned().map(Into::into).collect::<Vec<Bson>>()).boxed()
}

/// One of these names.
pub(crate) fn name(names: &'static [&'static str]) -> Gen<String> {
    select(names).prop_map(str::to_owned).boxed()
}

/// One of these, as often as its number says.
pub(crate) fn any_of<T: std::fmt::Debug + 'static>(choices: Vec<(u32, Gen<T>)>) -> Gen<T> {
    Union::new_weighted(choices).boxed()
}

/// One of these, each as often as the others.
pub(crate) fn either<T: std::fmt::Debug + 'static>(choices: Vec<Gen<T>>) -> Gen<T> {
    Union::new(choices).boxed()
}

/// An array of some of these, in any number up to `most`.
pub(crate) fn several(item: Gen, most: usize) -> Gen {
    vec(item, 0..=most).prop_map(Bson::Array).boxed()
}

/// An array of exactly these.
pub(crate) fn array(items: Vec<Gen>) -> Gen {
    items.prop_map(Bson::Array).boxed()
}

/// An object with one field.
pub(crate) fn object(name: &'static str, value: Gen) -> Gen {
    value.prop_map(move |value| Bson::Document(doc! { name: value })).boxed()
}

/// An object with these fields; those of weight below 100 come as often out of a hundred times.
pub(crate) fn fields(fields: Vec<(&'static str, u32, Gen)>) -> Gen {
    let fields: Vec<_> = fields
        .into_iter()
        .map(|(name, weight, value)| {
            (0..100u32, value).prop_map(move |(dice, value)| (dice < weight).then(|| (name.to_owned(), value)))
        })
        .collect();
    fields.prop_map(|fields| Bson::Document(fields.into_iter().flatten().collect())).boxed()
}

/// The document in a value that is one.
pub(crate) fn document(value: Bson) -> Document {
    match value {
        Bson::Document(document) => document,
        _ => Document::new(),
    }
}

fn decimal(text: &str) -> Bson {
    text.parse::<Decimal128>().map_or(Bson::Null, Bson::Decimal128)
}

pub(crate) fn int() -> Gen {
    pick(&[0, 1, 2, 3, -1, 5])
}

/// Numbers of all types, most of them small and equal to one of another type.
pub(crate) fn number() -> Gen {
    let odd = vec![
        Bson::Double(f64::NAN),
        Bson::Double(f64::INFINITY),
        Bson::Double(-0.0),
        Bson::Double(1e300),
        Bson::Int32(i32::MAX),
        Bson::Int64(i64::MAX),
        Bson::Int64(i64::MIN),
        Bson::Int64((1 << 53) + 1),
        decimal("NaN"),
        decimal("-Infinity"),
        decimal("1E+30"),
    ];
    any_of(vec![
        (8, int()),
        (3, pick(&[1.0, 2.0, 2.5, -1.5, 0.0])),
        (2, pick(&[1i64, 2, 3, -7])),
        (2, pick(&[decimal("1"), decimal("2.5"), decimal("2.50"), decimal("-3"), decimal("0")])),
        (1, pick(&odd)),
    ])
}

pub(crate) fn string() -> Gen {
    pick(&["", "a", "b", "ab", "abc", "A", "é", "1", "b a", "a\nb", "$a"])
}

pub(crate) fn date() -> Gen {
    let at = |millis| Bson::DateTime(DateTime::from_millis(millis));
    pick(&[at(0), at(951_827_696_789), at(1_583_020_799_999), at(-1), at(1_234_567_890_123)])
}

/// Values of the types that are neither numbers nor strings, arrays or objects.
pub(crate) fn rare() -> Gen {
    let binary = |subtype, bytes: &[u8]| Bson::Binary(Binary { subtype, bytes: bytes.to_vec() });
    let regex = |pattern: &str, options: &str| match (pattern.try_into(), options.try_into()) {
        (Ok(pattern), Ok(options)) => Bson::RegularExpression(Regex { pattern, options }),
        _ => Bson::Null,
    };
    any_of(vec![
        (4, date()),
        (2, pick(&[Bson::ObjectId(ObjectId::from_bytes([1; 12])), Bson::ObjectId(ObjectId::from_bytes([2; 12]))])),
        (1, pick(&[binary(BinarySubtype::Generic, b"ab"), binary(BinarySubtype::Uuid, b"ab")])),
        (1, pick(&[regex("a", ""), regex("^a", "i")])),
        (1, pick(&[Timestamp { time: 1, increment: 2 }, Timestamp { time: 2, increment: 1 }])),
        (1, pick(&[Bson::MinKey, Bson::MaxKey])),
    ])
}

pub(crate) fn scalar() -> Gen {
    any_of(vec![(6, number()), (4, string()), (2, pick(&[Bson::Null])), (1, pick(&[true, false])), (2, rare())])
}

/// Any value, nested at most so deeply.
pub(crate) fn value(depth: u32) -> Gen {
    if depth == 0 {
        return scalar();
    }
    any_of(vec![(6, scalar()), (3, several(value(depth - 1), 3)), (2, nested(depth - 1))])
}

/// An object of few fields.
pub(crate) fn nested(depth: u32) -> Gen {
    let inner = value(depth);
    fields(vec![("b", 70, inner.clone()), ("c", 50, inner.clone()), ("a", 20, inner)])
}

/// A path into the documents of [`wild`].
pub(crate) fn path() -> Gen<String> {
    any_of(vec![
        (8, name(&["a", "b", "c"])),
        (6, name(&["a.b", "a.c", "b.b", "b.c"])),
        (2, name(&["a.0", "a.1", "b.0", "a.0.b", "a.b.0", "a.b.c", "a.b.b"])),
        (1, name(&["_id", "d", "a.d", "a.1.c", "c.0.0"])),
    ])
}

/// A document of fields `a`, `b` and `c` with anything in them.
pub(crate) fn wild() -> Gen<Document> {
    let objects = several(nested(1), 3);
    let any = any_of(vec![(5, value(2)), (3, objects), (2, several(scalar(), 4))]);
    fields(vec![("a", 90, any.clone()), ("b", 60, any), ("c", 40, scalar())]).prop_map(document).boxed()
}

/// A document whose fields mostly are of the type that their names say:
/// numbers `n` and `m`, strings `s` and `t`, arrays `l` and `k`, a date `d`, an object `o`, anything in `x`.
pub(crate) fn typed() -> Gen<Document> {
    let mostly = |right: Gen| any_of(vec![(12, right), (1, scalar())]);
    fields(vec![
        ("n", 95, mostly(number())),
        ("m", 90, mostly(int())),
        ("s", 95, mostly(string())),
        ("t", 90, mostly(string())),
        ("l", 95, mostly(any_of(vec![(2, several(int(), 4)), (1, several(scalar(), 4)), (1, several(nested(0), 3))]))),
        ("k", 90, mostly(several(int(), 4))),
        ("d", 95, mostly(date())),
        ("o", 95, mostly(nested(1))),
        ("x", 70, value(1)),
    ])
    .prop_map(document)
    .boxed()
}
