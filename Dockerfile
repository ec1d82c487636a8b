# docker build -t unseen .
# docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/data" unseen complete scan.e57 -o completed
FROM python:3.13-slim

# loops are compiled once, here, for processors of the last ten years, into a folder that any user may write
ENV NUMBA_CACHE_DIR=/opt/unseen/compiled \
    NUMBA_CPU_NAME=x86-64-v3 \
    NUMBA_CPU_FEATURES=+avx,+avx2,+bmi,+bmi2,+f16c,+fma,+lzcnt,+movbe,+popcnt,+sse4.2,+xsave \
    MPLCONFIGDIR=/tmp \
    PYTHONDONTWRITEBYTECODE=1
COPY . /opt/unseen/source
RUN pip install --no-cache-dir "/opt/unseen/source[all]" \
    && rm -r /opt/unseen/source \
    && unseen warm --quiet \
    && chmod -R a+rwX "$NUMBA_CACHE_DIR"
WORKDIR /data
ENTRYPOINT ["unseen"]
