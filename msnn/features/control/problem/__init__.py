"""Problems of control and estimation as data, with their optimality conditions and scales."""
