//! The families of operators, and the commands of each.

use bson::{Bson, Document, doc};
use proptest::prelude::*;

use super::generate::value::{Gen, any_of, either, fields, name, path, pick, typed, wild};
use super::generate::{bomb, expression, text, window};
use super::generate::{filter, pipeline, projection, update};

/// What a family's cases are made of.
pub(super) struct Family {
    /// A document, without `_id`.
    pub(super) documents: Gen<Document>,
    /// How many there are.
    pub(super) count: usize,
    pub(super) commands: Gen<Document>,
    /// How much longer a case takes than others; so much fewer there are.
    pub(super) cost: usize,
    /// An index that there has to be.
    pub(super) index: Option<Document>,
}

/// A family by its name, made when it is wanted.
type Named = (&'static str, fn() -> Family);

/// All families, by name.
pub(super) const FAMILIES: &[Named] = &[
    ("filter_comparison", || over(wild(), find(filter::comparison()))),
    ("filter_logical", || over(wild(), find(filter::logical()))),
    ("filter_element", || over(wild(), find(filter::element()))),
    ("filter_regex", || over(wild(), find(filter::regex()))),
    ("filter_bitwise_and_mod", || over(wild(), find(filter::bitwise()))),
    ("filter_array", || over(wild(), find(filter::arrays()))),
    ("filter_expr", || over(typed(), find(filter::expr()))),
    ("filter_json_schema", || over(wild(), find(filter::schema()))),
    ("expression_arithmetic", || one_by_one(expression::arithmetic())),
    ("expression_transcendental", || one_by_one(expression::transcendental())),
    ("expression_string", || one_by_one(expression::strings())),
    ("expression_array", || one_by_one(expression::arrays())),
    ("expression_variable", || one_by_one(expression::variables())),
    ("expression_set", || one_by_one(expression::sets())),
    ("expression_date", || one_by_one(expression::dates())),
    ("expression_conditional", || one_by_one(expression::conditional())),
    ("expression_comparison_and_boolean", || one_by_one(either(vec![expression::comparison(), expression::boolean()]))),
    ("expression_conversion", || one_by_one(expression::conversion())),
    ("expression_object", || one_by_one(expression::objects())),
    ("expression_accumulator", || one_by_one(expression::accumulators())),
    ("projection_inclusion_and_exclusion", || {
        let either = either(vec![projection::inclusion(), projection::exclusion(), projection::mixed()]);
        over(wild(), project(either))
    }),
    ("projection_slice", || over(wild(), project(projection::slice()))),
    ("projection_elem_match", || over(wild(), project(projection::element()))),
    ("projection_positional", || Family { count: 2, ..over(wild(), project_matched(projection::positional())) }),
    ("projection_expression", || Family {
        count: 3,
        ..over(typed(), project(projection::computed(expression::any_group())))
    }),
    ("sort", || over(wild(), sort())),
    ("distinct", || over(wild(), distinct())),
    ("count_and_delete", || over(wild(), either(vec![count(), delete()]))),
    ("update_fields", || over(wild(), change(update::set()))),
    ("update_numbers", || over(both(), change(update::numbers()))),
    ("update_arrays", || over(both(), change(update::arrays()))),
    ("update_positional", || over(both(), change_elements())),
    ("update_replacement", || over(wild(), replace())),
    ("update_pipeline", || over(both(), change_by_pipeline())),
    ("update_upsert", || over(wild(), upsert())),
    ("stage_reshape", || Family { count: 3, ..over(both(), aggregate(pipeline::reshape())) }),
    ("stage_group", || Family { count: 8, ..over(both(), aggregate(pipeline::group())) }),
    ("stage_bucket", || Family { count: 8, ..over(both(), aggregate(pipeline::bucket())) }),
    ("stage_unwind", || over(wild(), aggregate(pipeline::unwind()))),
    ("stage_lookup", || over(wild(), aggregate(pipeline::lookup()))),
    ("stage_graph_lookup", || over(wild(), aggregate(pipeline::graph()))),
    ("stage_sequence", || over(wild(), aggregate(pipeline::sequence()))),
    ("stage_facet_union_redact", || over(wild(), aggregate(pipeline::combined()))),
    ("stage_window", || over(both(), aggregate(window::window()))),
    ("stage_densify_and_fill", || over(both(), aggregate(window::gaps()))),
    ("javascript_where", || Family { cost: 4, ..over(wild(), find(window::predicate())) }),
    ("javascript_function", || Family { cost: 4, ..one_by_one(window::function()) }),
    ("text_search", || Family { index: Some(text::index()), ..over(text::texts(), text::commands()) }),
    ("bomb_result", || bombs(aggregate(pipeline_of("$project", bomb::expression())))),
    ("bomb_group", || {
        let group = |value| doc! { "$group": { "_id": Bson::Null, "x": { "$push": value } } };
        bombs(aggregate(bomb::expression().prop_map(move |value| vec![group(value)]).boxed()))
    }),
    ("bomb_filter", || {
        bombs(find(bomb::expression().prop_map(|value| doc! { "$expr": { "$ne": [value, 1] } }).boxed()))
    }),
    ("bomb_update", || {
        let set = |value| doc! { "u": [{ "$set": { "x": value } }, { "$set": { "x": { "$type": "$x" } } }] };
        bombs(statement(
            pick(&[1, 2]).prop_map(|id| doc! { "_id": id }).boxed(),
            bomb::expression().prop_map(set).boxed(),
        ))
    }),
    ("stage_out_and_merge", || Family { cost: 4, ..over(wild(), aggregate(pipeline::output())) }),
];

fn over(documents: Gen<Document>, commands: Gen<Document>) -> Family {
    Family { documents, count: 12, commands, cost: 1, index: None }
}

/// Values of any size; what mongod makes of one takes long.
fn bombs(commands: Gen<Document>) -> Family {
    Family { count: 2, cost: 100, ..over(typed(), commands) }
}

fn pipeline_of(stage: &'static str, value: Gen) -> Gen<Vec<Document>> {
    value.prop_map(move |value| vec![doc! { stage: { "x": value } }]).boxed()
}

/// Expressions over very few documents: an error of one hides the values of all.
fn one_by_one(expression: Gen) -> Family {
    Family { count: 2, ..over(typed(), aggregate(expression::projected(expression))) }
}

/// Documents of both shapes.
fn both() -> Gen<Document> {
    (wild(), typed())
        .prop_map(|(mut wild, typed)| {
            wild.extend(typed);
            wild
        })
        .boxed()
}

fn find(filter: Gen<Document>) -> Gen<Document> {
    filter.prop_map(|filter| doc! { "find": "c", "filter": filter }).boxed()
}

fn project(projection: Gen<Document>) -> Gen<Document> {
    (filter::loose(), projection)
        .prop_map(|(filter, projection)| doc! { "find": "c", "filter": filter, "projection": projection })
        .boxed()
}

/// The positional projection wants a filter that says which element.
fn project_matched(projection: Gen<Document>) -> Gen<Document> {
    (any_of(vec![(3, matching("a")), (1, filter::simple())]), projection)
        .prop_map(|(filter, projection)| doc! { "find": "c", "filter": filter, "projection": projection })
        .boxed()
}

/// Conditions that say which element of an array is meant.
fn matching(field: &'static str) -> Gen<Document> {
    let within = format!("{field}.b");
    let compared = any_of(vec![
        (2, pick(&[doc! { "$exists": true }, doc! { "$gte": 1 }, doc! { "$gt": "" }, doc! { "$ne": 1 }])),
        (1, super::generate::value::scalar()),
    ]);
    (compared, 0..4u32)
        .prop_map(move |(condition, shape)| match (shape, condition) {
            (0, condition) => doc! { &within: condition },
            (1, Bson::Document(condition)) => doc! { field: { "$elemMatch": condition } },
            (2, Bson::Document(condition)) => doc! { field: { "$elemMatch": { "b": condition } } },
            (_, condition) => doc! { field: condition },
        })
        .boxed()
}

fn sort() -> Gen<Document> {
    (filter::loose(), projection::sort(), pick(&[0, 0, 1, 3]), pick(&[0, 0, 2, 5]))
        .prop_map(|(filter, sort, skip, limit)| {
            doc! { "find": "c", "filter": filter, "sort": sort, "skip": skip, "limit": limit }
        })
        .boxed()
}

fn distinct() -> Gen<Document> {
    let key = any_of(vec![(9, path()), (1, name(&["", "a.", "$a", "nothing"]))]);
    (key, filter::loose()).prop_map(|(key, filter)| doc! { "distinct": "c", "key": key, "query": filter }).boxed()
}

fn count() -> Gen<Document> {
    filter::simple().prop_map(|filter| doc! { "count": "c", "query": filter }).boxed()
}

fn delete() -> Gen<Document> {
    (filter::simple(), pick(&[0, 1]))
        .prop_map(|(filter, limit)| doc! { "delete": "c", "deletes": [{ "q": filter, "limit": limit }] })
        .boxed()
}

fn aggregate(stages: Gen<Vec<Document>>) -> Gen<Document> {
    stages.prop_map(|stages| doc! { "aggregate": "c", "pipeline": stages, "cursor": {} }).boxed()
}

/// An update statement: which documents, the change, and whether all or the first.
fn statement(filter: Gen<Document>, change: Gen<Document>) -> Gen<Document> {
    let flags = fields(vec![("multi", 50, pick(&[true])), ("upsert", 5, pick(&[true]))]);
    (filter, change, flags)
        .prop_map(|(filter, change, flags)| {
            let mut statement = doc! { "q": filter };
            statement.extend(change);
            statement.extend(flags.as_document().cloned().unwrap_or_default());
            doc! { "update": "c", "updates": [statement] }
        })
        .boxed()
}

fn one_or_some() -> Gen<Document> {
    any_of(vec![(4, pick(&[1, 2, 3, 4, 5]).prop_map(|id| doc! { "_id": id }).boxed()), (3, filter::loose())])
}

fn change(update: Gen<Document>) -> Gen<Document> {
    statement(one_or_some(), update.prop_map(|update| doc! { "u": update }).boxed())
}

fn change_elements() -> Gen<Document> {
    let filter = any_of(vec![(3, matching("a")), (2, matching("l")), (2, one_or_some())]);
    statement(filter, update::positional())
}

fn replace() -> Gen<Document> {
    (one_or_some(), update::replacement(), 0..10u32)
        .prop_map(|(filter, replacement, dice)| {
            let statement = doc! { "q": filter, "u": replacement, "upsert": dice == 0 };
            doc! { "update": "c", "updates": [statement] }
        })
        .boxed()
}

fn change_by_pipeline() -> Gen<Document> {
    let one = pick(&[1, 2, 3, 4, 5]).prop_map(|id| doc! { "_id": id }).boxed();
    statement(one, update::pipeline().prop_map(|stages| doc! { "u": stages }).boxed())
}

fn upsert() -> Gen<Document> {
    let stages = update::pipeline().prop_map(|stages| doc! { "u": stages }).boxed();
    let operators = update::any_operators().prop_map(|update| doc! { "u": update }).boxed();
    let replacement = update::replacement().prop_map(|replacement| doc! { "u": replacement }).boxed();
    let change = any_of(vec![(4, operators), (1, replacement), (1, stages), (1, update::positional())]);
    (update::absent(), change)
        .prop_map(|(filter, change)| {
            let mut statement = doc! { "q": filter };
            statement.extend(change);
            statement.insert("upsert", true);
            doc! { "update": "c", "updates": [statement] }
        })
        .boxed()
}
