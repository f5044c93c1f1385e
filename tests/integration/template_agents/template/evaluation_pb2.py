"""The template's message, as protoc of its time generates it: by names that protobuf kept since."""

from google.protobuf import descriptor_pb2 as _descriptor_pb2
from google.protobuf import descriptor_pool as _descriptor_pool
from google.protobuf import message as _message
from google.protobuf import reflection as _reflection

_FILE = _descriptor_pb2.FileDescriptorProto(name="evaluation.proto", package="evaluation",
                                            syntax="proto3")
_FILE.message_type.add(name="Package").field.add(
    name="SerializedEntity", number=1, type=_descriptor_pb2.FieldDescriptorProto.TYPE_BYTES,
    label=_descriptor_pb2.FieldDescriptorProto.LABEL_OPTIONAL)
DESCRIPTOR = _descriptor_pool.Default().AddSerializedFile(_FILE.SerializeToString())
Package = _reflection.GeneratedProtocolMessageType("Package", (_message.Message,), {
    "DESCRIPTOR": DESCRIPTOR.message_types_by_name["Package"], "__module__": "evaluation_pb2"})
