# A run on a mounted folder:
#   docker build -t bodytrack .
#   docker run --rm -v "$PWD:/data" -u "$(id -u):$(id -g)" bodytrack run run.toml
FROM python:3.11-slim
COPY . /src
ENV MPLCONFIGDIR=/tmp/matplotlib HOME=/tmp
RUN apt-get update -qq && apt-get install -y -qq --no-install-recommends g++ libc6-dev \
    && pip install --no-cache-dir "/src[export]" && rm -rf /src /var/lib/apt/lists/* \
    && apt-get purge -y -qq --auto-remove g++ libc6-dev
WORKDIR /data
ENTRYPOINT ["bodytrack"]
CMD ["--help"]
