; A robot brings things from room to room.
(define (domain delivery)
  (:requirements :strips :typing)
  (:types room thing)
  (:predicates
    (robot-in ?r - room)
    (door ?from ?to - room)
    (lies-in ?t - thing ?r - room)
    (carries ?t - thing)
    (free-hand))

  (:action go
    :parameters (?from ?to - room)
    :precondition (and (robot-in ?from) (door ?from ?to))
    :effect (and (not (robot-in ?from)) (robot-in ?to)))

  (:action pick-up
    :parameters (?t - thing ?r - room)
    :precondition (and (robot-in ?r) (lies-in ?t ?r) (free-hand))
    :effect (and (not (lies-in ?t ?r)) (not (free-hand)) (carries ?t)))

  (:action put-down
    :parameters (?t - thing ?r - room)
    :precondition (and (robot-in ?r) (carries ?t))
    :effect (and (not (carries ?t)) (free-hand) (lies-in ?t ?r))))
