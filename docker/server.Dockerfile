# The grading server. From the root of the sources (docker/README.md):
#   buildah build --format docker -f docker/server.Dockerfile -t myograde-server .
# BASE is a Debian 12. Pin it by its digest for a release: --build-arg BASE=docker.io/library/debian@sha256:...
ARG BASE=docker.io/library/debian:12-slim

FROM ${BASE} AS build
ENV DEBIAN_FRONTEND=noninteractive MYOGRADE_CACHE=/var/cache/myograde
WORKDIR /src
COPY docker/install_deps.sh docker/packages.txt docker/
RUN docker/install_deps.sh
COPY . .
# Dates the bill of materials (seconds since 1970; default: now, as git's folder is not here).
ARG SOURCE_DATE_EPOCH
RUN export SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(date +%s)} \
 && ./dev build \
 && cmake --install build/release --prefix /out/usr/local --strip \
 && test -s /out/usr/local/share/doc/myograde/third-party/NOTICE.txt \
 && mkdir -p /out/$MYOGRADE_CACHE/runtimes \
 && cp -a $MYOGRADE_CACHE/mujoco-2.2.2 $MYOGRADE_CACHE/models /out/$MYOGRADE_CACHE/ \
 && cp -a $MYOGRADE_CACHE/runtimes/python /out/$MYOGRADE_CACHE/runtimes/

FROM ${BASE}
RUN apt-get update -q \
 && DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends \
      bubblewrap ca-certificates iproute2 libabsl20220623 libarchive13 libcmark0.30.2 libcurl4 \
      libfmt9 libicu72 liblcm1 libpng16-16 libprometheus-cpp-core1.0 libseccomp2 libspdlog1.10 \
      libsqlite3-0 libssl3 libstdc++6 libzstd1 python3 zlib1g zstd \
 && rm -rf /var/lib/apt/lists/* /var/cache/apt/* /var/log/apt /var/log/dpkg.log
COPY --from=build /out/ /
# Its number, for whoever prepares a volume.
RUN useradd --uid 1000 --create-home --shell /usr/sbin/nologin myograde \
 && install -d -o myograde -g myograde -m 0750 /var/lib/myograde
ENV MYOGRADE_CACHE=/var/cache/myograde MYOGRADE_DATA=/var/lib/myograde
USER myograde
WORKDIR /var/lib/myograde
VOLUME /var/lib/myograde
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=30s --timeout=10s --start-period=60s CMD ["myograde", "status", "--json"]
ENTRYPOINT ["myograde"]
CMD ["serve"]
