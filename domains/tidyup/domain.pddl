; A domestic robot with two hands brings things back to where they belong.
; Doors join rooms; cupboards and the like are to be opened before use.
(define (domain tidyup)
  (:requirements :strips :typing :negative-preconditions)

  (:types
    room door place item hand - object
    surface container - place)

  (:predicates
    ; the building
    (joins ?door - door ?from ?to - room)    ; given in both directions
    (closed ?door - door)
    (in-room ?place - place ?room - room)

    ; places and the things on or in them
    (shut ?container - container)
    (accessible ?place - place)              ; a surface, or a container that is not shut
    (at ?item - item ?place - place)

    ; the robot
    (robot-in ?room - room)
    (holding ?hand - hand ?item - item)
    (full ?hand - hand))

  (:action open-door
    :parameters (?door - door ?room ?beyond - room ?hand - hand)
    :precondition (and (robot-in ?room) (joins ?door ?room ?beyond)
                       (closed ?door) (not (full ?hand)))
    :effect (not (closed ?door)))

  (:action go
    :parameters (?from ?to - room ?door - door)
    :precondition (and (robot-in ?from) (joins ?door ?from ?to)
                       (not (closed ?door)))
    :effect (and (robot-in ?to) (not (robot-in ?from))))

  (:action open
    :parameters (?container - container ?room - room ?hand - hand)
    :precondition (and (robot-in ?room) (in-room ?container ?room)
                       (shut ?container) (not (full ?hand)))
    :effect (and (accessible ?container) (not (shut ?container))))

  (:action close
    :parameters (?container - container ?room - room ?hand - hand)
    :precondition (and (robot-in ?room) (in-room ?container ?room)
                       (not (shut ?container)) (not (full ?hand)))
    :effect (and (shut ?container) (not (accessible ?container))))

  (:action pick-up
    :parameters (?item - item ?place - place ?room - room ?hand - hand)
    :precondition (and (robot-in ?room) (in-room ?place ?room)
                       (accessible ?place) (at ?item ?place)
                       (not (full ?hand)))
    :effect (and (holding ?hand ?item) (full ?hand)
                 (not (at ?item ?place))))

  (:action put-down
    :parameters (?item - item ?place - place ?room - room ?hand - hand)
    :precondition (and (robot-in ?room) (in-room ?place ?room)
                       (accessible ?place) (holding ?hand ?item))
    :effect (and (at ?item ?place)
                 (not (holding ?hand ?item)) (not (full ?hand)))))
