//! Landmarks: facts, or small sets of facts, of which one must be true at some time in every plan.
//!
//! They are found by going back from the goals (Richter, Helmert and Westphal 2008, "Landmarks revisited"; Porteous,
//! Sebastia and Hoffmann 2001): what all operators need that may achieve a landmark first is a landmark itself. Which
//! operators these are is approximated by relaxed reachability without the landmark (Zhu and Givan 2003 propagate
//! landmarks over the same graph).

pub(super) mod accepted;
pub(super) mod back;
pub(super) mod count;
pub(super) mod graph;
pub(super) mod reasonable;
mod transition;

#[cfg(test)]
mod tests {
    use super::super::example::{door, task};
    use super::super::relaxed::{Costs, Relaxed};
    use super::super::task::{Fact, Task};
    use super::back::landmarks;
    use super::count::Counter;
    use super::graph::{Graph, Order};
    use super::reasonable::order;

    fn graph(task: &Task) -> Graph {
        let mut relaxed = Relaxed::new(task, Costs::Unit);
        let mut graph = landmarks(task, &mut relaxed);
        order(task, &relaxed, &mut graph);
        graph
    }

    fn facts(graph: &Graph) -> Vec<Vec<Fact>> {
        let kept = graph.landmarks.iter().filter(|landmark| !landmark.is_gone);
        let mut facts: Vec<_> = kept.map(|landmark| landmark.facts.clone()).collect();
        facts.sort();
        facts
    }

    fn orders(graph: &Graph) -> Vec<(Fact, Fact, Order)> {
        let mut orders = Vec::new();
        for landmark in &graph.landmarks {
            for (after, order) in &landmark.after {
                orders.push((landmark.facts[0], graph.landmarks[*after as usize].facts[0], *order));
            }
        }
        orders.sort();
        orders
    }

    #[test]
    fn all_that_the_door_needs_is_a_landmark() {
        // 0 hall, 1 store, 2 room; 3 and 4 without and with the key; 5 and 6 closed and open.
        assert_eq!(facts(&graph(&door())), [[0], [1], [2], [3], [4], [5], [6]]);
    }

    #[test]
    fn landmarks_come_in_the_order_of_every_plan() {
        let found = orders(&graph(&door()));
        for expected in [
            (6, 2, Order::GreedyNecessary),
            (0, 2, Order::GreedyNecessary),
            (4, 6, Order::GreedyNecessary),
            (1, 4, Order::GreedyNecessary),
        ] {
            assert!(found.contains(&expected), "{expected:?} in {found:?}");
        }
    }

    #[test]
    fn one_of_two_keys_is_a_disjunctive_landmark() {
        let mut task = task(
            &[2, 2, 2],
            &[0; 3],
            &[(2, 1)],
            &[
                ("take-one", &[(0, 0)], &[(0, 1)]),
                ("take-two", &[(1, 0)], &[(1, 1)]),
                ("open-one", &[(0, 1)], &[(2, 1)]),
                ("open-two", &[(1, 1)], &[(2, 1)]),
            ],
        );
        // Having the one and having the other are facts of the same predicate.
        task.predicates = vec![None, Some(0), None, Some(0), None, Some(1)];
        assert_eq!(facts(&graph(&task)), [vec![1, 3], vec![5]]);
    }

    #[test]
    fn a_value_that_cannot_be_avoided_is_a_landmark() {
        // A walk over four places, the second by two ways.
        let task = task(
            &[5],
            &[0],
            &[(0, 4)],
            &[
                ("a", &[(0, 0)], &[(0, 1)]),
                ("b", &[(0, 0)], &[(0, 2)]),
                ("c", &[(0, 1)], &[(0, 3)]),
                ("d", &[(0, 2)], &[(0, 3)]),
                ("e", &[(0, 3)], &[(0, 4)]),
            ],
        );
        let simple: Vec<_> = facts(&graph(&task)).into_iter().filter(|facts| facts.len() == 1).collect();
        assert_eq!(simple, [[0], [3], [4]]);
    }

    /// Painting the ceiling takes one to the ladder; in the end, one is to stand at the door.
    fn ladder() -> Task {
        task(
            &[3, 2],
            &[0, 0],
            &[(0, 2), (1, 1)],
            &[("to-ladder", &[], &[(0, 1)]), ("to-door", &[], &[(0, 2)]), ("paint", &[(0, 1)], &[(1, 1)])],
        )
    }

    #[test]
    fn what_was_achieved_too_early_counts_as_open() {
        let task = ladder();
        let counter = Counter::new(&task, &graph(&task));
        let mut marks = vec![0; counter.words()];
        counter.start(&task, &task.init, &mut marks);
        let mut counts = vec![counter.count(&task, &task.init, &marks)];
        // To the door, to the ladder, the ceiling, to the door again.
        for state in [[2, 3], [1, 3], [1, 4], [2, 4]] {
            let before = marks.clone();
            counter.accept(&task, &state, &before, &mut marks);
            counts.push(counter.count(&task, &state, &marks));
        }
        assert_eq!(counts, [3, 3, 2, 1, 0]);
    }

    #[test]
    fn what_both_need_is_no_reason_for_an_order() {
        // With a free hand, one waves, and one takes the key: then the hand is not free.
        let mut task = task(
            &[2, 2, 2],
            &[0, 0, 0],
            &[(1, 1), (2, 1)],
            &[("wave", &[(0, 0)], &[(1, 1)]), ("take", &[(0, 0)], &[(0, 1), (2, 1)]), ("free", &[], &[(0, 0), (2, 0)])],
        );
        let has = |task: &Task, order| orders(&graph(task)).contains(&order);
        let (free, waved, taken) = (0, 3, 5);
        task.mutexes = vec![vec![free, taken]];
        assert!(has(&task, (free, waved, Order::GreedyNecessary)) && has(&task, (free, taken, Order::GreedyNecessary)));
        assert!(!has(&task, (waved, taken, Order::Reasonable)));
    }

    #[test]
    fn what_destroys_a_goal_is_done_before_it_reasonably() {
        let task = ladder();
        let (door, ceiling) = (2, 4);
        let found = orders(&graph(&task));
        assert!(found.contains(&(ceiling, door, Order::Reasonable)), "{found:?}");
        assert!(!found.contains(&(door, ceiling, Order::Reasonable)), "{found:?}");
    }

    #[test]
    fn orders_have_no_circles() {
        for task in (0..200).map(super::super::example::random) {
            let graph = graph(&task);
            let mut left: Vec<usize> = (0..graph.landmarks.len()).collect();
            // Landmarks without predecessors are removed until none is left.
            while !left.is_empty() {
                let before = left.len();
                let waits = |number: &usize| {
                    graph.landmarks[*number].before.iter().any(|(other, _)| left.contains(&(*other as usize)))
                };
                let next: Vec<usize> = left.iter().copied().filter(waits).collect();
                left = next;
                assert!(left.len() < before, "{graph:?}");
            }
        }
    }

    #[test]
    fn landmarks_are_counted_until_they_are_achieved() {
        let task = door();
        let counter = Counter::new(&task, &graph(&task));
        let mut marks = vec![0; counter.words()];
        counter.start(&task, &task.init, &mut marks);
        // To come: the store, the key, the open door, the room.
        assert_eq!(counter.count(&task, &task.init, &marks), 4);
        let mut counts = Vec::new();
        for state in [[1, 3, 5], [1, 4, 5], [0, 4, 5], [0, 4, 6], [2, 4, 6]] {
            let before = marks.clone();
            counter.accept(&task, &state, &before, &mut marks);
            counts.push(counter.count(&task, &state, &marks));
        }
        // In the store, the hall has to be reached again.
        assert_eq!(counts, [4, 3, 2, 1, 0]);
    }
}
