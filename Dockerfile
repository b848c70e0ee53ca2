# ohmward on board, for x86-64 and ARM:
#   docker build -t ohmward .
#   docker run --network host -v /etc/ohmward:/etc/ohmward:ro -v ohmward:/var/lib/ohmward ohmward
FROM python:3.12-slim AS build
WORKDIR /source
COPY pyproject.toml README.md LICENSE ./
COPY src src
COPY lab lab
RUN python -m venv /opt/ohmward && /opt/ohmward/bin/pip install --no-cache-dir ".[page,can,serial,mqtt]"

FROM python:3.12-slim
COPY --from=build /opt/ohmward /opt/ohmward
# Compiled programs are kept only in a folder of the user's own.
RUN useradd --system --uid 1801 --user-group --no-create-home --shell /usr/sbin/nologin ohmward \
    && install -d -m 0700 -o ohmward -g ohmward /var/lib/ohmward /var/cache/ohmward
ENV PATH=/opt/ohmward/bin:$PATH \
    OHMWARD_CACHE=/var/cache/ohmward
# By number, which a host can resolve too.
USER 1801:1801
WORKDIR /var/lib/ohmward
VOLUME /var/lib/ohmward
STOPSIGNAL SIGTERM
# With a token the page answers 401: it lives too.
HEALTHCHECK --interval=30s --timeout=5s --start-period=60s CMD ["python", "-c", "import http.client; c = http.client.HTTPConnection('127.0.0.1', 8080, timeout=4); c.request('GET', '/api/now'); raise SystemExit(c.getresponse().status not in (200, 401))"]
ENTRYPOINT ["ohmward"]
CMD ["run", "--log-format", "json", "/etc/ohmward/robot.toml"]
