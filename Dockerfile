# legoworld with Blender's Python module, for machines where nothing may be installed.
#   docker build -t legoworld .
#   docker run --rm -v "$PWD:/work" legoworld readout scenes --task coco -o runs/coco
FROM python:3.11-slim-bookworm AS build
RUN apt-get update && apt-get install -y --no-install-recommends g++ && rm -rf /var/lib/apt/lists/*
COPY . /source
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels /source

FROM python:3.11-slim-bookworm
COPY legoworld/system_libraries.py /tmp/system_libraries.py
# bubblewrap serves `legoworld execute`; inside a container it needs user namespaces to be allowed.
RUN apt-get update \
 && apt-get install -y --no-install-recommends bubblewrap $(python /tmp/system_libraries.py --packages) \
 && rm -rf /var/lib/apt/lists/* /tmp/system_libraries.py
COPY --from=build /wheels /wheels
COPY constraints/python-3.11.txt /wheels/
RUN pip install --no-cache-dir -c /wheels/python-3.11.txt "$(ls /wheels/legoworld-*.whl)[draco,exr,url,examples]" \
 && pip install --no-cache-dir --no-deps lvis==0.5.3 \
 && rm -rf /wheels
RUN useradd --create-home legoworld
USER legoworld
WORKDIR /work
ENTRYPOINT ["legoworld"]
CMD ["--help"]
