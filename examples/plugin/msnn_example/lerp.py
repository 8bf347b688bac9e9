"""The function `lerp`: between two values, by a share."""

from msnn.extending import GraphBuilder, NodeId


def lerp(builder: GraphBuilder, a: NodeId, b: NodeId, share: NodeId) -> NodeId:
    """a + share * (b - a)."""
    return builder.add(a, builder.multiply(share, builder.subtract(b, a)))
