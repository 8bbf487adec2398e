"""The actions of the blocks world. A real robot would move blocks; this one changes the memory, as perception would."""


def act(world, action, *blocks, session):
    """Changes the documents of the world as an action changes the world."""

    def add(**document):
        world.insert_one(document, session=session)

    def remove(**document):
        if world.delete_one(document, session=session).deleted_count != 1:
            raise RuntimeError(f"{action} {' '.join(blocks)}: there is no {document}")

    top, bottom = (*blocks, None)[:2]
    if action == "pickup":
        remove(relation="on-table", object=top)
        remove(relation="clear", object=top)
        add(relation="holding", object=top)
    elif action == "putdown":
        remove(relation="holding", object=top)
        add(relation="on-table", object=top)
        add(relation="clear", object=top)
    elif action == "stack":
        remove(relation="holding", object=top)
        remove(relation="clear", object=bottom)
        add(relation="on", object_top=top, object_bottom=bottom)
        add(relation="clear", object=top)
    elif action == "unstack":
        remove(relation="on", object_top=top, object_bottom=bottom)
        remove(relation="clear", object=top)
        add(relation="clear", object=bottom)
        add(relation="holding", object=top)
    else:
        raise ValueError(f"no action {action}")
