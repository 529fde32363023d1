# dlokit for a user without a home, on a root that nobody may write. `.ci/try-dockerfile` tries it.
#
#   docker build --tag dlokit .
#   docker run --rm --read-only --tmpfs /tmp --shm-size 256m --user "$(id -u)" --volume "$PWD:/work" dlokit
#
# Each start compiles for about a minute, unless the code is kept: --volume "$HOME/.cache/dlokit:/code" --env NUMBA_CACHE_DIR=/code
FROM python:3.12-slim
RUN apt-get update -qq \
    && apt-get install -qq --yes --no-install-recommends libegl1 libopengl0 libgl1-mesa-dri git \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /dlokit
COPY requirements.lock .
RUN pip install --no-cache-dir --require-hashes --requirement requirements.lock
COPY . .
RUN pip install --no-cache-dir --no-deps .
USER 2000
WORKDIR /work
ENTRYPOINT ["dlokit"]
CMD ["shape", "--headless"]
