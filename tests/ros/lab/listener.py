"""A reader of the lab: ``python listener.py [NODE]``.

Orders (`exchange` has their form):

- subscribe: topic, type, reliable, transient_local, depth. Says "subscribed"; then "message" for each message with
  topic, stamp_ns (ROS time, None without a stamp), arrived_ns (wall clock), bytes, sha256 (of the CDR), and fields. A
  publisher that offers too little is told by "incompatible" with topic and policy.
- unsubscribe: topic.
- call: service (of type std_srvs/srv/Trigger), within_s. Says "called" with success, message and seconds; success is
  None when no answer came in time.
- graph: says "graph" with topics (name: types), services (name: types) and nodes.
- endpoints: topic. Says "endpoints" with publishers and subscriptions: node, type, reliable, transient_local, hash.
- read: path (a file of one message in CDR), type, again (a path). Says "read" with fields, and writes what rclpy
  makes of the message again.

A wrong order is answered with "error".
"""

import hashlib
import queue
import sys
import threading
import time
import traceback
from pathlib import Path

import rclpy
from exchange import interface, orders, qos, say, stamp_ns, told
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import ExternalShutdownException
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message

LOOK_S = 0.02
"""Longest pause between two looks at the orders; messages do not wait for it [s]."""


class Listener:
    """The node with its subscriptions."""

    def __init__(self, name):
        self._node = rclpy.create_node(name)
        self._subscriptions = {}
        self._clients = {}
        self._asked = []

    def spin(self):
        rclpy.spin_once(self._node, timeout_sec=LOOK_S)
        for asked in tuple(self._asked):
            asked()

    def subscribe(self, order):
        topic, kind = order["topic"], interface(order["type"])

        def heard(cdr):
            arrived_ns, message = time.time_ns(), deserialize_message(cdr, kind)
            say(
                "message",
                topic=topic,
                stamp_ns=stamp_ns(message),
                arrived_ns=arrived_ns,
                bytes=len(cdr),
                sha256=hashlib.sha256(cdr).hexdigest(),
                fields=told(message),
            )

        def incompatible(event):
            say("incompatible", topic=topic, policy=str(event.last_policy_kind))

        self._subscriptions[topic] = self._node.create_subscription(
            kind,
            topic,
            heard,
            qos(order),
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=incompatible),
        )
        say("subscribed", topic=topic)

    def unsubscribe(self, order):
        self._node.destroy_subscription(self._subscriptions.pop(order["topic"]))

    def call(self, order):
        kind, name = interface("std_srvs/srv/Trigger"), order["service"]
        client = self._clients.setdefault(name, self._node.create_client(kind, name))
        began_s, future = time.monotonic(), None

        def look():
            nonlocal future
            seconds = time.monotonic() - began_s
            if future is None and client.service_is_ready():
                future = client.call_async(kind.Request())
            if future is not None and future.done():
                answer = future.result()
                say("called", service=name, success=answer.success, message=answer.message, seconds=seconds)
            elif seconds > order["within_s"]:
                why = "no answer" if future else "no such service"
                say("called", service=name, success=None, message=why, seconds=seconds)
            else:
                return
            self._asked.remove(look)

        self._asked.append(look)

    def graph(self, order):
        del order
        say(
            "graph",
            topics=dict(self._node.get_topic_names_and_types()),
            services=dict(self._node.get_service_names_and_types()),
            nodes=[f"{folder.rstrip('/')}/{name}" for name, folder in self._node.get_node_names_and_namespaces()],
        )

    def endpoints(self, order):
        topic = order["topic"]
        say(
            "endpoints",
            topic=topic,
            publishers=[described(one) for one in self._node.get_publishers_info_by_topic(topic)],
            subscriptions=[described(one) for one in self._node.get_subscriptions_info_by_topic(topic)],
        )

    def read(self, order):
        message = deserialize_message(Path(order["path"]).read_bytes(), interface(order["type"]))
        Path(order["again"]).write_bytes(serialize_message(message))
        say("read", path=order["path"], fields=told(message))


def described(endpoint):
    qos = endpoint.qos_profile
    return {
        "node": f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}",
        "type": endpoint.topic_type,
        "reliable": qos.reliability == ReliabilityPolicy.RELIABLE,
        "transient_local": qos.durability == DurabilityPolicy.TRANSIENT_LOCAL,
        "hash": str(endpoint.topic_type_hash),
    }


def main():
    rclpy.init()
    listener = Listener(sys.argv[1] if len(sys.argv) > 1 else "lab_listener")
    kinds = ("subscribe", "unsubscribe", "call", "graph", "endpoints", "read")
    carry_out = {kind: getattr(listener, kind) for kind in kinds}
    waiting = queue.SimpleQueue()

    def take():
        for order, _ in orders():
            waiting.put(order)
        waiting.put(None)

    threading.Thread(target=take, daemon=True).start()
    say("ready")
    while True:
        try:
            listener.spin()
            order = waiting.get_nowait()
        except queue.Empty:
            continue
        except (KeyboardInterrupt, ExternalShutdownException):
            break
        if order is None:
            break
        try:
            carry_out[order["kind"]](order)
        except Exception as error:
            say("error", order=order, text="".join(traceback.format_exception(error)))
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
