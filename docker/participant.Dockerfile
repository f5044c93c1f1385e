# A base image for participants: Python and the kit, as the sandboxes have them. From the root of the
# sources, then in the participant's own Dockerfile "FROM myograde-policy" (docker/README.md):
#   buildah build -f docker/participant.Dockerfile -t myograde-policy .
ARG BASE=docker.io/library/debian:12-slim

FROM ${BASE} AS build
RUN apt-get update -q \
 && DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends \
      ca-certificates liblcm-bin python3 python3-pip python3-venv
COPY . /src
# The wheels of the runtime "python", each pinned by SHA-256.
RUN python3 -m pip install -q --target /out --no-deps --only-binary :all: --require-hashes \
      -r /src/policies/runtimes/python/requirements.txt \
 && mkdir /types \
 && lcm-gen -p --ppath /types /src/protocol/policy/myograde.lcm /src/protocol/log/myograde_log.lcm \
 && mv /types/myograde/__init__.py /types/myograde/messages.py \
 && cp -r /src/policies/python/myograde /types/myograde /out/ \
 && cp /src/LICENSE /src/docker/wheels.txt /out/myograde/ \
 && find /out -name __pycache__ -prune -exec rm -rf {} +

FROM ${BASE}
RUN apt-get update -q \
 && DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends libglib2.0-0 python3 \
 && rm -rf /var/lib/apt/lists/* /var/cache/apt/* /var/log/apt /var/log/dpkg.log
COPY --from=build /out/ /usr/local/lib/python3.11/dist-packages/
WORKDIR /app
USER 1000
CMD ["python3", "policy.py"]
