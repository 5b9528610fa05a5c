"""A square with two anchors lost on the way: the mission is flown all the same, and in its place."""

SQUARE = [(4.0, 4.0, 1.2), (4.0, 6.0, 1.2), (6.0, 6.0, 1.2), (6.0, 4.0, 1.2), (4.0, 4.0, 1.2)]


def test_a_square_with_anchors_lost(haltere):
    haltere.at(item=2).fault("anchor", anchor=3)
    haltere.at(near=(6.0, 6.0, 1.2)).fault("anchor", anchor=5)
    haltere.station().fly(SQUARE)
    haltere.assert_track(SQUARE, within=0.5)
    haltere.assert_landed()
    haltere.assert_no_events(but=["anchor"])
