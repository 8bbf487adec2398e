; Blocks on a table and one hand that moves them.
(define (domain blocksworld)
  (:requirements :strips)

  (:predicates
    (on-table ?x)   ; the block stands on the table
    (on ?x ?y)      ; block ?x stands on block ?y
    (clear ?x)      ; nothing stands on the block, and the hand does not hold it
    (holding ?x)    ; the hand holds the block
    (hand-empty))   ; the hand holds nothing

  (:action pickup
    :parameters (?x)
    :precondition (and (on-table ?x) (clear ?x) (hand-empty))
    :effect (and (holding ?x)
                 (not (on-table ?x)) (not (clear ?x)) (not (hand-empty))))

  (:action putdown
    :parameters (?x)
    :precondition (holding ?x)
    :effect (and (on-table ?x) (clear ?x) (hand-empty)
                 (not (holding ?x))))

  (:action stack
    :parameters (?x ?y)
    :precondition (and (holding ?x) (clear ?y))
    :effect (and (on ?x ?y) (clear ?x) (hand-empty)
                 (not (holding ?x)) (not (clear ?y))))

  (:action unstack
    :parameters (?x ?y)
    :precondition (and (on ?x ?y) (clear ?x) (hand-empty))
    :effect (and (holding ?x) (clear ?y)
                 (not (on ?x ?y)) (not (clear ?x)) (not (hand-empty)))))
