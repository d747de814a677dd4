# Two images: `docker build --target server .` runs studies and analyses votes; `--target recon` reconstructs as well.
FROM python:3.13-slim-trixie AS build
WORKDIR /src
COPY requirements-build.lock ./
RUN pip install --no-cache-dir --require-hashes -r requirements-build.lock
COPY frontend frontend
RUN frontend/vendor.sh
COPY LICENSE README.md pyproject.toml setup.py ./
COPY migrations migrations
COPY templates templates
COPY docs docs
COPY languages languages
COPY static static
COPY ground ground
COPY recon recon
COPY app app
RUN pip wheel --no-deps --no-build-isolation --wheel-dir /wheels .

FROM python:3.13-slim-trixie AS server
RUN useradd --create-home --uid 1000 reconstudy && install -d -o reconstudy -g reconstudy /data
COPY requirements-server.lock /locks/
RUN pip install --no-cache-dir --require-hashes -r /locks/requirements-server.lock
COPY --from=build /wheels /wheels
RUN pip install --no-cache-dir --no-deps /wheels/*.whl
USER 1000
WORKDIR /data
VOLUME /data
ENV RECONSTUDY_DATA_DIR=/data/reconstudy
EXPOSE 8000
HEALTHCHECK --start-period=30s --interval=10s --timeout=5s \
  CMD ["python", "-c", "from urllib.request import urlopen; urlopen('http://127.0.0.1:8000/healthz', timeout=4)"]
ENTRYPOINT ["reconstudy"]
CMD ["serve", "--host", "0.0.0.0"]

FROM server AS recon
USER 0
# Offscreen OpenGL for the videos, what Open3D is linked to (libgl1, libidn2, libusb), and numba's threads (libgomp1).
# hadolint ignore=DL3008
RUN apt-get update \
  && apt-get install -y --no-install-recommends libegl1 libgl1 libgl1-mesa-dri libgomp1 libidn2-0 libusb-1.0-0 \
  && rm -rf /var/lib/apt/lists/*
COPY requirements-recon.lock /locks/
RUN pip install --no-cache-dir --require-hashes -r /locks/requirements-server.lock -r /locks/requirements-recon.lock
USER 1000
HEALTHCHECK NONE
CMD ["--help"]
