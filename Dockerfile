# syntax=docker/dockerfile:1
# One image for all services of docker-compose.yml. docs/containers.md says how it is used.
ARG PYTHON=3.12

FROM python:${PYTHON}-slim AS build
# cpu, or cuda12 for NVIDIA's cards: the wheels bring CUDA along, the host its driver.
ARG JAX=cpu
ENV PATH=/opt/entoptic/bin:$PATH \
    PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_CACHE_DIR=1 PIP_ROOT_USER_ACTION=ignore
WORKDIR /build
RUN python -m venv /opt/entoptic
# What the program needs changes seldom: a layer of its own.
COPY requirements.lock ./
RUN pip install --only-binary=:all: -r requirements.lock "jax[${JAX}]"
COPY pyproject.toml README.md LICENSE ./
COPY src src
COPY tracker_bridge tracker_bridge
COPY pipeline pipeline
COPY services services
RUN pip install --no-deps --no-build-isolation .

FROM python:${PYTHON}-slim
LABEL org.opencontainers.image.title="entoptic" \
      org.opencontainers.image.description="Shows what a person would see: HDR frames and the live state of the eyes in, perceived frames out."
RUN groupadd --gid 1000 entoptic \
    && useradd --uid 1000 --gid 1000 --no-create-home --home-dir /tmp --shell /usr/sbin/nologin entoptic \
    # A new volume takes its rights from these folders: whatever user compose names can write there.
    && install -d -m 1777 /cache /observers /recordings /sessions /state
COPY --from=build /opt/entoptic /opt/entoptic
ENV PATH=/opt/entoptic/bin:$PATH PYTHONDONTWRITEBYTECODE=1 PYTHONUNBUFFERED=1 \
    HOME=/tmp MPLCONFIGDIR=/tmp/matplotlib XDG_CACHE_HOME=/cache XDG_STATE_HOME=/state
USER 1000:1000
WORKDIR /sessions
ENTRYPOINT ["entoptic"]
CMD ["--help"]
