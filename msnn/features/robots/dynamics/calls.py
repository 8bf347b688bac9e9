"""Lowers calls of a robot's functions: `arm.mass_matrix(q)`, `arm.tip.position(q)`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from compiler.elaboration.names import PartMembers
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Concat, Constant, Reshape
from compiler.ir.program import NodeId
from compiler.ir.rules import UnitConflict, same_unit
from compiler.ir.types import Axis, Type, describe_axes, in_order
from compiler.linking.link import LinkedPart
from compiler.lowering.context import Context, LoweringFailed, SolvedCall
from compiler.lowering.environment import Environment
from compiler.lowering.expressions import lower_all
from msnn.features.robots import errors
from msnn.features.robots.dynamics.members import (
    FRAME_MEMBERS,
    MEMBERS,
    UNITS,
    FrameMember,
    Quantity,
    RobotMember,
    forward_dynamics,
    undetermined_joint,
)
from msnn.features.robots.dynamics.numbers import Number, SignedNode
from msnn.features.robots.dynamics.rigid_bodies import RigidBodies, with_masses
from msnn.features.robots.urdf.robot import Robot
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.errors import names
from spec_schema.expressions.tree import Call, Expression, Member, Name
from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import Unit


def lower_robot_call(
    context: Context, part: LinkedPart[Robot], call: Call, environment: Environment
) -> NodeId:
    """The node of a call `NAME.member(…)` or `NAME.frame.member(…)` of a robot, whose `part` has
    its full names in the spec. Raises LoweringFailed after reporting an error.
    """
    assert isinstance(call.function, Member)
    return _RobotCall(
        context=context, part=part, robot=part.model, call=call, environment=environment
    ).lowered(call.function)


@dataclass(frozen=True, kw_only=True)
class _RobotCall:
    """The lowering of one call of a robot's function. Errors are reported to the context, then
    LoweringFailed is raised.
    """

    context: Context
    part: LinkedPart[Robot]
    robot: Robot
    call: Call
    environment: Environment

    def lowered(self, function: Member) -> NodeId:
        member = self._member(function)
        arguments, nodes = self._arguments(member)
        bodies = with_masses(self.robot, self._parameter)
        if function.name == "forward_dynamics":
            self._refuse_singular()
        if isinstance(member, FrameMember):
            place = self.robot.frames[function.base.removeprefix(f"{self.part.name}.")]
            found = member.compute(bodies, place, arguments)
        else:
            found = self._by_position(member.compute(bodies, arguments))
        result = self._joined(found, self._own_axes(member), self._unit(member.result), nodes)
        if function.name == "forward_dynamics":
            self._remember(result, bodies, arguments, nodes)
        return result

    def _member(self, function: Member) -> RobotMember | FrameMember:
        frames = self.robot.frames
        if function.base == self.part.name and function.name in MEMBERS:
            return MEMBERS[function.name]
        frame = function.base.removeprefix(f"{self.part.name}.")
        if frame in frames and function.name in FRAME_MEMBERS:
            return FRAME_MEMBERS[function.name]
        self.context.findings.report(unknown_member(self.part, function))
        raise LoweringFailed

    def _arguments(
        self, member: RobotMember | FrameMember
    ) -> tuple[list[list[Number]], list[NodeId]]:
        """The elements of each argument of `member`, in the order of bodies, and the nodes of the
        arguments.
        """
        given = self._given(member.arguments)
        nodes = lower_all(self.context, given, self.environment)
        found: list[list[Number]] = []
        for quantity, expression, node in zip(member.arguments, given, nodes, strict=True):
            self._agree_on_unit(quantity, node)
            self._refuse_axes(member, quantity, expression, node)
            found.append(self._in_bodies(self._elements(node)))
        return found, nodes

    def _given(self, wanted: Sequence[Quantity]) -> list[Expression]:
        """The expression of each argument in the order of `wanted`, whether passed by position or
        by name. Reports wrong names and numbers of arguments.
        """
        call, shown = self.call, _shown(self.call.function)
        given: dict[str, Expression] = dict(zip(wanted, call.arguments, strict=False))
        for keyword in call.keywords:
            if keyword.name not in wanted or keyword.name in given:
                report = names.unknown_keyword(shown, keyword.name, keyword.span, wanted)
                self.context.findings.report(report)
                raise LoweringFailed
            given[keyword.name] = keyword.value
        found = len(call.arguments) + len(call.keywords)
        if found != len(wanted):
            expected = f"{len(wanted)} argument{'s' if len(wanted) > 1 else ''}"
            report = names.wrong_argument_count(
                shown, f"{expected} ({', '.join(wanted)})", found, call.function.span
            )
            self.context.findings.report(report)
            raise LoweringFailed
        return [given[name] for name in wanted]

    def _own_axes(self, member: RobotMember | FrameMember) -> tuple[Axis, ...]:
        """The axes that a result has independently of the arguments: joints, pairs of joints or x,
        y, z.
        """
        if isinstance(member, FrameMember):
            return (self._axis("xyz"),)
        if member.along == "pairs of joints":
            return self._joint, self._axis("joint2")
        return (self._joint,)

    def _refuse_axes(
        self,
        member: RobotMember | FrameMember,
        quantity: Quantity,
        expression: Expression,
        node: NodeId,
    ) -> None:
        """Reports the argument `quantity`, and raises LoweringFailed, if its axes do not fit.

        It must have the axis of the joints and none of the result's axes; a scalar argument holds
        for all joints.
        """
        axes = self._builder.type(node).axes
        rest = [axis for axis in axes if axis != self._joint]
        # a scalar is the same number at every joint; axes beside the joints, as a window, are kept
        if axes == tuple(rest) != () or any(axis in rest for axis in self._own_axes(member)):
            shown, wanted = _shown(self.call.function), f"`{self._joint.name}`"
            report = errors.argument_of_robot(
                shown, quantity, wanted, describe_axes(axes), expression.span
            )
            self.context.findings.report(report)
            raise LoweringFailed

    def _elements(self, node: NodeId) -> list[Number]:
        """The element of an argument for each joint, in the order of q; a scalar is used for all
        joints.
        """
        builder, joint = self._builder, self._joint
        axes = builder.type(node).axes
        op = builder.node(node).op
        if not axes:
            # a literal stays a number, so that sums with 0 and products with ±1 fold away
            value = op.values[0] if isinstance(op, Constant) else self._scalar(node)
            return [value] * joint.size
        if isinstance(op, Constant) and axes == (joint,):
            return list(op.values)
        return [self._scalar(builder.element(node, joint.name, i)) for i in range(joint.size)]

    def _agree_on_unit(self, quantity: Quantity, node: NodeId) -> None:
        """Adds a unit conflict to the builder for an argument with another unit than `quantity`; a
        literal 0 fits every unit.
        """
        unit, builder = self._unit(quantity), self._builder
        found = builder.type(node).unit
        op = builder.node(node).op
        is_zero = isinstance(op, Constant) and not any(op.values)
        if unit is not None and found is not None and not is_zero and not same_unit(found, unit):
            conflict = UnitConflict(_shown(self.call.function), found, unit)
            builder.conflicts.append(conflict)

    def _parameter(self, base: str, row: int) -> list[Number]:
        """The elements of the parameter `base` (`mass`, `com`, `size` or `shear`) of the body in
        this row: one for the mass, else three.
        """
        name = Name(self.part.names[base], self.call.span)
        node = self.context.names.value(name, self.environment)
        node = self._builder.element(node, self._axis("body").name, row)
        if base == "mass":
            return [self._scalar(node)]
        space = self._axis("xyz")
        each = (self._builder.element(node, space.name, i) for i in range(space.size))
        return [self._scalar(one) for one in each]

    def _refuse_singular(self) -> None:
        """Reports a robot whose mass matrix is singular with the masses of its file, and raises
        LoweringFailed.
        """
        # with the masses that the file has: those that are learned are known only where the model
        # runs
        known = with_masses(replace(self.robot, learned=frozenset()), self._parameter)
        joint = undetermined_joint(known)
        if joint is not None:
            body = self.robot.bodies[joint]
            report = errors.moves_without_mass(body.joint, body.span)
            self.context.findings.report(report.seen_from(self.call.span, "called here"))
            raise LoweringFailed

    def _remember(
        self,
        result: NodeId,
        bodies: RigidBodies,
        arguments: Sequence[Sequence[Number]],
        nodes: Sequence[NodeId],
    ) -> None:
        """Registers, for implicit integrators, a second way to compute `result`, the node of
        forward dynamics: with a node added to the diagonal of the mass matrix.
        """
        unit = self._unit("ddq")

        def with_diagonal(diagonal: NodeId) -> NodeId:
            builder, joint = self._builder, self._joint
            each = [builder.element(diagonal, joint.name, i) for i in range(joint.size)]
            added = self._in_bodies([self._scalar(node) for node in each])
            found = self._by_position(forward_dynamics(bodies, arguments, added))
            return self._joined(found, (joint,), unit, (*nodes, diagonal))

        self.context.solved_calls[result] = SolvedCall(nodes[-1], with_diagonal)

    def _in_bodies(self, numbers: Sequence[Number]) -> list[Number]:
        """Reorders elements from the order of q to the order of bodies."""
        return [numbers[position] for position in self.robot.positions]

    def _by_position(self, numbers: Sequence[Number]) -> list[Number]:
        """Reorders elements (or rows and columns) from the order of bodies to that of q."""
        positions = self.robot.positions
        at = {position: index for index, position in enumerate(positions)}
        order = [at[position] for position in range(len(positions))]
        if len(numbers) == len(order):
            return [numbers[index] for index in order]
        # of pairs: rows and columns of the matrix are both in the order of bodies
        return [numbers[i * len(order) + j] for i in order for j in order]

    def _joined(
        self,
        numbers: Sequence[Number],
        axes: tuple[Axis, ...],
        unit: Unit | None,
        arguments: Sequence[NodeId],
    ) -> NodeId:
        """Combines the elements to one node with these axes, this unit, and the further axes of the
        arguments, such as a window.

        The further axes are added even if no element depends on an argument.
        """
        builder = self._builder
        nodes = [self._node(number) for number in numbers]
        rest: tuple[Axis, ...] = ()
        for node in arguments:
            more = (axis for axis in builder.type(node).axes if axis != self._joint)
            rest = in_order((*rest, *(axis for axis in more if axis not in rest)))
        # no dim of a spec has a blank: none of the arguments is meant
        flat = Axis(f"{self.part.name}.{len(nodes)} numbers", 1)
        parts = [builder.reshape(builder.broadcast(node, rest), (flat, *rest)) for node in nodes]
        whole = Axis(flat.name, len(parts))
        # emitted with the unit of the result: numbers of turning and sliding joints have none in
        # common
        joined = builder.emit(Concat(flat.name), tuple(parts), Type((whole, *rest), unit))
        if len(parts) == 1:
            joined = parts[0]
        return builder.emit(Reshape(), (joined,), Type((*axes, *rest), unit))

    def _node(self, number: Number) -> NodeId:
        if isinstance(number, SignedNode):
            return number.as_node()
        return self._builder.constant(number, unit=None)

    def _scalar(self, node: NodeId) -> SignedNode:
        """A scalar node without its unit, for sums of angles and lengths, which q may
        contain both.
        """
        builder = self._builder
        type = builder.type(node)
        if type.unit is not None:
            node = builder.emit(Reshape(), (node,), type.with_unit(None))
        return SignedNode(builder, node)

    def _unit(self, quantity: Quantity) -> Unit | None:
        """The unit of a quantity; None if revolute and prismatic joints have different units."""
        turning, sliding = UNITS[quantity]
        slides = self.robot.slides
        if slides is None and turning != sliding:
            return None
        return parse_unit(sliding if slides else turning)

    @property
    def _builder(self) -> GraphBuilder:
        return self.context.builder(self.environment)

    @property
    def _joint(self) -> Axis:
        return self._axis(self.robot.joint)

    def _axis(self, base: str) -> Axis:
        name = self.part.names[base]
        return Axis(name, self.context.spec.dims[name].size)


def unknown_member(part: LinkedPart[Robot], member: Member) -> Diagnostic:
    """The diagnostic for an unknown member of a robot or of one of its frames."""
    known = FRAME_MEMBERS if member.base != part.name else (*MEMBERS, *part.model.frames)
    return errors.unknown_robot_member(f"{member.base}.{member.name}", member.span, known)


def _shown(function: Name | Member) -> str:
    return function.name if isinstance(function, Name) else f"{function.base}.{function.name}"


ROBOT_MEMBERS = PartMembers(call=lower_robot_call, unknown=unknown_member)
