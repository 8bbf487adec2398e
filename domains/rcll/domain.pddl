; Production in the RoboCup Logistics League: robots carry workpieces between
; machines that build a product for an order: a base, up to three rings, a cap.
;
; An order's complexity C0 to C3 is the number of its rings. A ring may cost
; additional bases, which robots pay into the ring station beforehand. A cap
; reaches its station on a carrier from the station's shelf; when the cap is
; buffered, the carrier comes out as a plain base, good for a payment.
(define (domain rcll)
  (:requirements :strips :typing :negative-preconditions)

  (:types
    base-station ring-station cap-station delivery-station - machine
    robot machine side workpiece order gate - object
    base-color ring-color cap-color - object
    complexity amount - object)

  (:constants
    INPUT OUTPUT - side
    C0 C1 C2 C3 - complexity
    N0 N1 N2 N3 - amount)

  (:predicates
    ; robots; a machine's side has room for one of them
    (outside ?robot - robot)
    (at ?robot - robot ?machine - machine ?side - side)
    (occupied ?machine - machine ?side - side)
    (busy ?robot - robot)
    (holding ?robot - robot ?workpiece - workpiece)
    (holding-base ?robot - robot)            ; any base, or a carrier without its cap

    ; workpieces
    (unused ?workpiece - workpiece)
    (made-for ?workpiece - workpiece ?order - order)
    (rings ?workpiece - workpiece ?rings - complexity)
    (capped ?workpiece - workpiece)
    (ready-at ?workpiece - workpiece ?machine - machine) ; at its output
    (output-blocked ?machine - machine)

    ; machines
    (caps-on-shelf ?station - cap-station ?caps - amount)
    (mounts-cap ?station - cap-station ?cap - cap-color)
    (cap-buffered ?station - cap-station)
    (carrier-at-output ?station - cap-station)
    (mounts-ring ?station - ring-station ?ring - ring-color)
    (ring-cost ?ring - ring-color ?bases - amount)
    (paid ?station - ring-station ?bases - amount)

    ; orders
    (order-complexity ?order - order ?complexity - complexity)
    (order-base ?order - order ?base - base-color)
    (order-ring ?order - order ?rings - complexity ?ring - ring-color)
    (order-cap ?order - order ?cap - cap-color)
    (order-gate ?order - order ?gate - gate)
    (started ?order - order)
    (fulfilled ?order - order)

    ; arithmetic
    (one-more ?rings ?more - complexity)
    (plus-one ?amount ?more - amount)
    (minus ?amount ?less ?rest - amount))

  ; ---- robots ----

  (:action enter
    :parameters (?robot - robot ?to - machine ?to_side - side)
    :precondition (and (outside ?robot) (not (occupied ?to ?to_side)))
    :effect (and (at ?robot ?to ?to_side) (occupied ?to ?to_side)
                 (not (outside ?robot))))

  (:action move
    :parameters (?robot - robot ?from - machine ?from_side - side
                 ?to - machine ?to_side - side)
    :precondition (and (at ?robot ?from ?from_side)
                       (not (occupied ?to ?to_side)))
    :effect (and (at ?robot ?to ?to_side) (occupied ?to ?to_side)
                 (not (at ?robot ?from ?from_side))
                 (not (occupied ?from ?from_side))))

  (:action pick
    :parameters (?robot - robot ?workpiece - workpiece ?machine - machine)
    :precondition (and (at ?robot ?machine OUTPUT)
                       (ready-at ?workpiece ?machine)
                       (not (busy ?robot)))
    :effect (and (holding ?robot ?workpiece) (busy ?robot)
                 (not (ready-at ?workpiece ?machine))
                 (not (output-blocked ?machine))))

  ; ---- bases ----

  (:action dispense
    :parameters (?station - base-station ?workpiece - workpiece
                 ?order - order ?base - base-color)
    :precondition (and (unused ?workpiece)
                       (order-base ?order ?base)
                       (not (started ?order))
                       (not (output-blocked ?station)))
    :effect (and (made-for ?workpiece ?order) (rings ?workpiece C0)
                 (started ?order)
                 (ready-at ?workpiece ?station) (output-blocked ?station)
                 (not (unused ?workpiece))))

  ; A base that only pays for a ring; its color and name do not matter.
  (:action fetch-base
    :parameters (?robot - robot ?station - base-station)
    :precondition (and (at ?robot ?station OUTPUT)
                       (not (output-blocked ?station))
                       (not (busy ?robot)))
    :effect (and (holding-base ?robot) (busy ?robot)))

  (:action discard
    :parameters (?robot - robot)
    :precondition (holding-base ?robot)
    :effect (and (not (holding-base ?robot)) (not (busy ?robot))))

  ; ---- rings ----
  ; What a robot puts into a station's input is ready at its output at once.

  (:action pay
    :parameters (?robot - robot ?station - ring-station ?paid ?now - amount)
    :precondition (and (at ?robot ?station INPUT)
                       (holding-base ?robot)
                       (paid ?station ?paid)
                       (plus-one ?paid ?now))
    :effect (and (paid ?station ?now) (not (paid ?station ?paid))
                 (not (holding-base ?robot)) (not (busy ?robot))))

  (:action mount-ring
    :parameters (?robot - robot ?station - ring-station ?workpiece - workpiece
                 ?order - order ?ring - ring-color
                 ?rings ?now - complexity ?paid ?cost ?rest - amount)
    :precondition (and (at ?robot ?station INPUT) (holding ?robot ?workpiece)
                       (not (output-blocked ?station))
                       (made-for ?workpiece ?order)
                       (rings ?workpiece ?rings)
                       (one-more ?rings ?now)
                       (order-ring ?order ?now ?ring)
                       (mounts-ring ?station ?ring)
                       (ring-cost ?ring ?cost)
                       (paid ?station ?paid)
                       (minus ?paid ?cost ?rest))
    :effect (and (rings ?workpiece ?now) (not (rings ?workpiece ?rings))
                 (paid ?station ?rest) (not (paid ?station ?paid))
                 (ready-at ?workpiece ?station) (output-blocked ?station)
                 (not (holding ?robot ?workpiece)) (not (busy ?robot))))

  ; ---- caps ----

  ; The robot takes a carrier from the shelf and puts it into the input beside it.
  (:action buffer-cap
    :parameters (?robot - robot ?station - cap-station ?caps ?left - amount)
    :precondition (and (at ?robot ?station INPUT)
                       (caps-on-shelf ?station ?caps)
                       (plus-one ?left ?caps)
                       (not (cap-buffered ?station))
                       (not (output-blocked ?station))
                       (not (busy ?robot)))
    :effect (and (cap-buffered ?station)
                 (caps-on-shelf ?station ?left)
                 (not (caps-on-shelf ?station ?caps))
                 (carrier-at-output ?station) (output-blocked ?station)))

  (:action pick-carrier
    :parameters (?robot - robot ?station - cap-station)
    :precondition (and (at ?robot ?station OUTPUT)
                       (carrier-at-output ?station)
                       (not (busy ?robot)))
    :effect (and (holding-base ?robot) (busy ?robot)
                 (not (carrier-at-output ?station))
                 (not (output-blocked ?station))))

  (:action mount-cap
    :parameters (?robot - robot ?station - cap-station ?workpiece - workpiece
                 ?order - order ?cap - cap-color ?rings - complexity)
    :precondition (and (at ?robot ?station INPUT) (holding ?robot ?workpiece)
                       (not (output-blocked ?station))
                       (made-for ?workpiece ?order)
                       (rings ?workpiece ?rings)
                       (order-complexity ?order ?rings)
                       (order-cap ?order ?cap)
                       (mounts-cap ?station ?cap)
                       (cap-buffered ?station)
                       (not (capped ?workpiece)))
    :effect (and (capped ?workpiece) (not (cap-buffered ?station))
                 (ready-at ?workpiece ?station) (output-blocked ?station)
                 (not (holding ?robot ?workpiece)) (not (busy ?robot))))

  ; ---- delivery ----

  (:action deliver
    :parameters (?robot - robot ?station - delivery-station ?workpiece - workpiece
                 ?order - order ?gate - gate)
    :precondition (and (at ?robot ?station INPUT) (holding ?robot ?workpiece)
                       (made-for ?workpiece ?order)
                       (capped ?workpiece)
                       (order-gate ?order ?gate))
    :effect (and (fulfilled ?order)
                 (not (holding ?robot ?workpiece)) (not (busy ?robot)))))
