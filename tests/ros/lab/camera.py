"""A camera of the lab, and whatever else publishes there: ``python camera.py [NODE]``.

Orders (`exchange` has their form):

- topic: topic, type, reliable, transient_local, depth. Makes its publisher.
- image: topic, stamp_ns, frame, width, height, encoding, step; the payload is its data.
- compressed: topic, stamp_ns, frame, format; the payload is its data.
- info: topic, stamp_ns, frame, width, height, model, d, k, r, p (a CameraInfo).
- cloud: topic, stamp_ns, frame, width, height, fields ([name, offset, datatype, count] each), point_step, row_step,
  dense; the payload is its data.
- transform: parent, child, position_m, xyzw, stamp_ns, static. On /tf_static, or on /tf.
- bytes: topic; the payload is the message in CDR.
- remove: topic. Ends its publisher.
- await: topic, count. Says "matched" when the topic has at least so many subscriptions.
- drive: colour, depth, info (topics), frame, width, height, hz, seconds, reliable, apart (from colour to depth [s], 0),
  history (messages kept for a reader that is late, 10). Once each topic has a subscription, publishes pictures with
  depth by itself, stamped as they are published, and says "driven" at the end; until then no other order is carried
  out. The first four bytes of each picture are its number, from 0, little-endian.

What is published is not answered. A wrong order is answered with "error".
"""

import array
import sys
import time
import traceback

import numpy as np
import rclpy
from exchange import interface, orders, qos, say
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2, PointField

LOOK_S = 0.01


class Camera:
    """The node with its publishers."""

    def __init__(self, name):
        self._node = rclpy.create_node(name)
        self._publishers = {}
        self._static = {}

    def topic(self, order, payload):
        del payload
        self._publishers[order["topic"]] = self._node.create_publisher(
            interface(order["type"]), order["topic"], qos(order)
        )

    def remove(self, order, payload):
        del payload
        self._node.destroy_publisher(self._publishers.pop(order["topic"]))

    def bytes(self, order, payload):
        self._publishers[order["topic"]].publish(payload)

    def image(self, order, payload):
        message = stamped(Image(), order, "height", "width", "encoding", "step")
        message.data = array.array("B", payload)
        self._publishers[order["topic"]].publish(message)

    def compressed(self, order, payload):
        message = stamped(CompressedImage(), order, "format")
        message.data = array.array("B", payload)
        self._publishers[order["topic"]].publish(message)

    def info(self, order, payload):
        del payload
        self._publishers[order["topic"]].publish(info_of(order))

    def cloud(self, order, payload):
        message = stamped(PointCloud2(), order, "height", "width", "point_step", "row_step")
        message.fields = [
            PointField(name=name, offset=offset, datatype=datatype, count=count)
            for name, offset, datatype, count in order["fields"]
        ]
        message.is_dense = order["dense"]
        message.data = array.array("B", payload)
        self._publishers[order["topic"]].publish(message)

    def transform(self, order, payload):
        del payload
        from geometry_msgs.msg import TransformStamped

        transform = stamped(TransformStamped(), {**order, "frame": order["parent"]})
        transform.child_frame_id = order["child"]
        moved, turned = transform.transform.translation, transform.transform.rotation
        moved.x, moved.y, moved.z = order["position_m"]
        turned.x, turned.y, turned.z, turned.w = order["xyzw"]
        kind, static = interface("tf2_msgs/msg/TFMessage"), order["static"]
        topic = "/tf_static" if static else "/tf"
        if topic not in self._publishers:
            how = {"transient_local": static, "depth": 1 if static else 100}
            self._publishers[topic] = self._node.create_publisher(kind, topic, qos(how))
        if static:  # a late subscriber gets the last message alone, which therefore has all of them
            self._static[order["child"]] = transform
        self._publishers[topic].publish(kind(transforms=list(self._static.values()) if static else [transform]))

    def await_(self, order, payload):
        del payload
        publisher = self._publishers[order["topic"]]
        while publisher.get_subscription_count() < order["count"]:
            time.sleep(LOOK_S)
        say("matched", topic=order["topic"])

    def drive(self, order, payload):
        del payload
        width, height = order["width"], order["height"]
        size = {"width": width, "height": height, "frame": order["frame"], "stamp_ns": 0}
        pixels = np.random.default_rng(0).integers(400, 2000, (height, width, 4), np.uint16)
        names = ("height", "width", "encoding", "step")
        colour = stamped(Image(), {**size, "encoding": "rgb8", "step": 3 * width}, *names)
        depth = stamped(Image(), {**size, "encoding": "16UC1", "step": 2 * width}, *names)
        colour.data = array.array("B", pixels[..., :3].astype(np.uint8).tobytes())
        depth.data = array.array("B", pixels[..., 3].tobytes())
        k = [600.0, 0.0, (width - 1) / 2, 0.0, 600.0, (height - 1) / 2, 0.0, 0.0, 1.0]
        info = info_of({**size, "model": "plumb_bob", "d": [0.0] * 5, "k": k})
        parts = [(order["colour"], Image, colour), (order["depth"], Image, depth), (order["info"], CameraInfo, info)]
        how = qos({"reliable": order.get("reliable", True), "depth": order.get("history", 10)})
        publishers = [(self._node.create_publisher(kind, topic, how), part) for topic, kind, part in parts]
        for publisher, _ in publishers:
            while publisher.get_subscription_count() < 1:
                time.sleep(LOOK_S)
        count, late_s, began_s = round(order["hz"] * order["seconds"]), 0.0, time.monotonic()
        for number in range(count):
            due_s = began_s + number / order["hz"]
            time.sleep(max(0.0, due_s - time.monotonic()))
            late_s = max(late_s, time.monotonic() - due_s)
            for message in (colour, depth):
                message.data[:4] = array.array("B", number.to_bytes(4, "little"))
            now_ns = time.time_ns()
            for publisher, message in publishers:
                set_stamp(message.header, now_ns)
                publisher.publish(message)
                time.sleep(order.get("apart", 0.0) if message is colour else 0.0)
        say("driven", published=count, late_s=late_s, seconds=time.monotonic() - began_s)


def set_stamp(header, stamp_ns):
    header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns, 10**9)


def stamped(message, order, *names):
    """A message with the stamp and frame of an order, and the fields named."""
    set_stamp(message.header, order["stamp_ns"])
    message.header.frame_id = order["frame"]
    for name in names:
        setattr(message, name, order[name])
    return message


def info_of(order):
    message = stamped(CameraInfo(), order, "height", "width", "d", "k")
    message.distortion_model = order["model"]
    k = order["k"]
    message.r = order.get("r", [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    message.p = order.get("p", [*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0])
    return message


def main():
    rclpy.init()
    camera = Camera(sys.argv[1] if len(sys.argv) > 1 else "lab_camera")
    kinds = ("topic", "image", "compressed", "info", "cloud", "transform", "bytes", "remove", "drive")
    carry_out = {**{kind: getattr(camera, kind) for kind in kinds}, "await": camera.await_}
    say("ready")
    for order, payload in orders():
        try:
            carry_out[order["kind"]](order, payload)
        except Exception as error:
            say("error", order=order, text="".join(traceback.format_exception(error)))
    rclpy.shutdown()


if __name__ == "__main__":
    main()
