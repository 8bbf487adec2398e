//! Tasks in the manner of the unsolvability competition of 2016, small ones, whose answers are known by other means: those
//! without a plan are proven to have none within a limit of work, and no others are.

use ferroplan::parser::{parse_domain, parse_problem};

use super::convert::convert;
use super::search::{End, Event, Ground, Improvement, Settings, ground, simulate::check, solve};

/// The work for each task: a second or so.
const WORK: u64 = 100_000_000;

/// Whether a plan was found; `None` where neither that nor a proof was possible.
fn is_solvable(domain: &str, problem: &str) -> Option<bool> {
    let lifted = convert(&parse_domain(domain).unwrap(), &parse_problem(problem).unwrap()).unwrap();
    let task = match ground(&lifted, 1 << 26, &mut |_, _| {}).unwrap() {
        Ground::GoalFalse => return Some(false),
        Ground::Task(task) => task,
    };
    let settings = Settings { improvement: Improvement::Brief, memory: 1 << 28, work: WORK };
    let mut plan = Vec::new();
    let end = solve(&task, settings, &mut |event| {
        if let Event::Plan(found) = event {
            let words = |operator: &u32| task.name(*operator).map(str::to_owned).collect::<Vec<_>>();
            plan = found.iter().map(words).map(|words| (words[0].clone(), words[1..].to_vec())).collect();
        }
    });
    match end {
        End::Solved => {
            assert_eq!(check(&lifted, &plan), Ok(()), "{problem}");
            Some(true)
        }
        End::Unsolvable => Some(false),
        End::Full | End::Spent => None,
    }
}

fn objects(letter: &str, count: usize) -> String {
    (0..count).map(|number| format!("{letter}{number} ")).collect()
}

/// Facts of neighbours on a line, as `(next p0 p1)`.
fn line(predicate: &str, letter: &str, count: usize) -> String {
    (1..count).map(|number| format!("({predicate} {letter}{} {letter}{number})", number - 1)).collect()
}

/// A truck on a line of places brings packages to the right; each drive takes a unit of fuel (as in over-nomystery).
fn transport(fuel: usize, packages: &[(usize, usize)]) -> Option<bool> {
    let domain = "(define (domain transport) (:requirements :typing) (:types place package level)
        (:predicates (truck ?p - place) (at ?k - package ?p - place) (in ?k - package) (road ?a ?b - place)
          (fuel ?l - level) (less ?l ?m - level))
        (:action drive :parameters (?a ?b - place ?l ?m - level)
          :precondition (and (truck ?a) (road ?a ?b) (fuel ?m) (less ?l ?m))
          :effect (and (not (truck ?a)) (truck ?b) (not (fuel ?m)) (fuel ?l)))
        (:action load :parameters (?k - package ?p - place) :precondition (and (truck ?p) (at ?k ?p))
          :effect (and (not (at ?k ?p)) (in ?k)))
        (:action drop :parameters (?k - package ?p - place) :precondition (and (truck ?p) (in ?k))
          :effect (and (not (in ?k)) (at ?k ?p))))";
    let places = packages.iter().map(|(_, to)| *to).max().unwrap_or_default() + 1;
    let facts = |place: fn(&(usize, usize)) -> usize| -> String {
        packages.iter().enumerate().map(|(number, package)| format!("(at k{number} p{})", place(package))).collect()
    };
    let back: String = (1..places).map(|number| format!("(road p{number} p{})", number - 1)).collect();
    let problem = format!(
        "(define (problem p) (:domain transport) (:objects {}- place {}- package {}- level)
        (:init (truck p0) (fuel l{fuel}) {} {back} {} {}) (:goal (and {})))",
        objects("p", places),
        objects("k", packages.len()),
        objects("l", fuel + 1),
        line("road", "p", places),
        line("less", "l", fuel + 1),
        facts(|package| package.0),
        facts(|package| package.1),
    );
    is_solvable(domain, &problem)
}

#[test]
fn a_truck_needs_fuel_to_the_last_of_the_places() {
    for packages in [vec![(0, 3), (1, 2)], vec![(1, 4), (2, 3), (0, 2)], vec![(2, 5), (0, 1), (1, 3), (3, 4)]] {
        let needed = packages.iter().map(|(_, to)| *to).max().unwrap();
        for fuel in 1..needed + 2 {
            assert_eq!(transport(fuel, &packages), Some(fuel >= needed), "{packages:?} with {fuel}");
        }
    }
}

/// A rover that has to be at some ends of a star, and drives a unit there and a unit back (as in over-rovers).
#[test]
fn a_rover_needs_energy_for_each_way_but_the_last_one_back() {
    let domain = "(define (domain rover) (:requirements :typing) (:types place level)
        (:predicates (at ?p - place) (way ?a ?b - place) (energy ?l - level) (less ?l ?m - level) (seen ?p - place))
        (:action drive :parameters (?a ?b - place ?l ?m - level)
          :precondition (and (at ?a) (way ?a ?b) (energy ?m) (less ?l ?m))
          :effect (and (not (at ?a)) (at ?b) (not (energy ?m)) (energy ?l)))
        (:action look :parameters (?p - place) :precondition (at ?p) :effect (seen ?p)))";
    for ends in 2..5 {
        for energy in ends..2 * ends + 1 {
            let ways: String = (1..=ends).map(|end| format!("(way p0 p{end}) (way p{end} p0)")).collect();
            let seen: String = (1..=ends).map(|end| format!("(seen p{end})")).collect();
            let problem = format!(
                "(define (problem p) (:domain rover) (:objects {}- place {}- level)
                (:init (at p0) (energy l{energy}) {ways} {}) (:goal (and {seen})))",
                objects("p", ends + 1),
                objects("l", energy + 1),
                line("less", "l", energy + 1),
            );
            assert_eq!(is_solvable(domain, &problem), Some(energy >= 2 * ends - 1), "{ends} with {energy}");
        }
    }
}

/// People who have to cross by stones that sink behind them (as in bottleneck and pigeons).
#[test]
fn as_many_cross_as_there_are_stones() {
    let domain = "(define (domain river) (:requirements :typing) (:types person stone)
        (:predicates (here ?p - person) (on ?p - person ?s - stone) (there ?p - person) (dry ?s - stone))
        (:action step :parameters (?p - person ?s - stone) :precondition (and (here ?p) (dry ?s))
          :effect (and (not (here ?p)) (not (dry ?s)) (on ?p ?s)))
        (:action back :parameters (?p - person ?s - stone) :precondition (on ?p ?s)
          :effect (and (not (on ?p ?s)) (here ?p)))
        (:action land :parameters (?p - person ?s - stone) :precondition (on ?p ?s)
          :effect (and (not (on ?p ?s)) (there ?p))))";
    for (people, stones) in [(2, 2), (3, 2), (4, 4), (5, 4), (6, 5)] {
        let of_people =
            |predicate: &str| -> String { (0..people).map(|number| format!("({predicate} p{number})")).collect() };
        let dry: String = (0..stones).map(|number| format!("(dry s{number})")).collect();
        let problem = format!(
            "(define (problem p) (:domain river) (:objects {}- person {}- stone) (:init {} {dry}) (:goal (and {})))",
            objects("p", people),
            objects("s", stones),
            of_people("here"),
            of_people("there"),
        );
        assert_eq!(is_solvable(domain, &problem), Some(people <= stones), "{people} people, {stones} stones");
    }
}

/// A pebble is replaced by one to its right and one above it. The three of the corner never all leave it (Kontsevich 1981).
#[test]
fn pebbles_do_not_leave_their_corner() {
    let domain = "(define (domain pebbles) (:requirements :typing) (:types number)
        (:predicates (pebble ?x ?y - number) (free ?x ?y - number) (next ?x ?y - number))
        (:action split :parameters (?x ?y ?a ?b - number)
          :precondition (and (next ?x ?a) (next ?y ?b) (pebble ?x ?y) (free ?a ?y) (free ?x ?b))
          :effect (and (not (pebble ?x ?y)) (free ?x ?y) (pebble ?a ?y) (not (free ?a ?y))
            (pebble ?x ?b) (not (free ?x ?b)))))";
    let corner = [(0, 0), (0, 1), (1, 0)];
    for (size, start, goal, expected) in [
        (4, &corner[..], &corner[..], false),
        (5, &corner[..], &corner[..], false),
        (4, &corner[..1], &corner[..1], true),
        (4, &corner[..1], &corner[..], true),
        (4, &corner[..], &corner[..1], true),
    ] {
        let squares = (0..size).flat_map(|x| (0..size).map(move |y| (x, y)));
        let facts = squares.map(|(x, y)| {
            let predicate = if start.contains(&(x, y)) { "pebble" } else { "free" };
            format!("({predicate} n{x} n{y})")
        });
        let goal: String = goal.iter().map(|(x, y)| format!("(free n{x} n{y})")).collect();
        let problem = format!(
            "(define (problem p) (:domain pebbles) (:objects {}- number) (:init {} {}) (:goal (and {goal})))",
            objects("n", size),
            line("next", "n", size),
            facts.collect::<String>(),
        );
        assert_eq!(is_solvable(domain, &problem), Some(expected), "{size} {start:?} {goal}");
    }
}

/// Whether pegs on a row, as bits, can be reduced to one by jumps, by looking at all of them.
fn is_reducible(pegs: u32, size: u32) -> bool {
    let jumps =
        (0..size - 2).flat_map(|place| [(0b011, 0b100), (0b110, 0b001)].map(|(from, to)| (from << place, to << place)));
    let mut after = jumps.filter(|(from, to)| pegs & (from | to) == *from).map(|(from, to)| pegs & !from | to);
    pegs.count_ones() == 1 || after.any(|pegs| is_reducible(pegs, size))
}

#[test]
fn pegs_on_a_row() {
    let domain = "(define (domain row) (:requirements :typing) (:types hole level)
        (:predicates (peg ?h - hole) (free ?h - hole) (row ?a ?b ?c - hole) (left ?l - level) (less ?l ?m - level))
        (:action jump :parameters (?a ?b ?c - hole ?l ?m - level)
          :precondition (and (row ?a ?b ?c) (peg ?a) (peg ?b) (free ?c) (left ?m) (less ?l ?m))
          :effect (and (not (peg ?a)) (not (peg ?b)) (not (free ?c)) (free ?a) (free ?b) (peg ?c)
            (not (left ?m)) (left ?l))))";
    let size = 7;
    let mut counts = [0; 2];
    for pegs in (1..1_u32 << size).step_by(3) {
        let facts: String =
            (0..size).map(|hole| format!("({} h{hole})", if pegs >> hole & 1 == 1 { "peg" } else { "free" })).collect();
        let rows: String = (2..size)
            .map(|hole| format!("(row h{0} h{1} h{2}) (row h{2} h{1} h{0})", hole - 2, hole - 1, hole))
            .collect();
        let problem = format!(
            "(define (problem p) (:domain row) (:objects {}- hole {}- level)
            (:init {facts} {rows} {} (left l{})) (:goal (left l1)))",
            objects("h", size),
            objects("l", size + 1),
            line("less", "l", size + 1),
            pegs.count_ones(),
        );
        let expected = is_reducible(pegs, size as u32);
        assert_eq!(is_solvable(domain, &problem), Some(expected), "{pegs:b}");
        counts[usize::from(expected)] += 1;
    }
    assert!(counts[0] > 10 && counts[1] > 10, "{counts:?}");
}

/// Tiles on a board of two by three: half of their orders are out of reach.
#[test]
fn tiles_of_the_other_parity_are_out_of_reach() {
    let domain = "(define (domain tiles) (:requirements :typing) (:types tile place)
        (:predicates (at ?t - tile ?p - place) (gap ?p - place) (near ?p ?q - place))
        (:action slide :parameters (?t - tile ?p ?q - place) :precondition (and (at ?t ?p) (gap ?q) (near ?p ?q))
          :effect (and (not (at ?t ?p)) (not (gap ?q)) (at ?t ?q) (gap ?p))))";
    let mut near = String::new();
    for place in 0..6_i32 {
        let is_near = |other: &i32| (place / 3 - other / 3).abs() + (place % 3 - other % 3).abs() == 1;
        (0..6).filter(is_near).for_each(|other| near.push_str(&format!("(near p{place} p{other})")));
    }
    for order in [[0, 1, 2, 3, 4], [1, 0, 2, 3, 4], [4, 3, 2, 1, 0], [1, 2, 0, 3, 4], [0, 1, 2, 4, 3], [2, 4, 1, 3, 0]]
    {
        let pairs = (0..5).flat_map(|one| (one + 1..5).map(move |other| (one, other)));
        let is_even = pairs.filter(|(one, other)| order[*one] > order[*other]).count() % 2 == 0;
        let at = |places: &[usize]| -> String {
            places.iter().enumerate().map(|(tile, place)| format!("(at t{tile} p{place})")).collect()
        };
        let problem = format!(
            "(define (problem p) (:domain tiles) (:objects {}- tile {}- place)
            (:init {near} {} (gap p5)) (:goal (and {})))",
            objects("t", 5),
            objects("p", 6),
            at(&order),
            at(&[0, 1, 2, 3, 4]),
        );
        assert_eq!(is_solvable(domain, &problem), Some(is_even), "{order:?}");
    }
}
