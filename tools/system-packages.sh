#!/bin/sh
# Installs the system libraries that the optional outputs want, pango for the PDF and GL for the 3-D surfaces, and the packages
# given: Chromium and poppler for the tests of the report. Works as root on Debian and its kin; says what to do elsewhere.
# Never fails the build.
set -u
wanted="libpango-1.0-0 libpangoft2-1.0-0 libgl1 libegl1 libusb-1.0-0 $*"
command -v dpkg-query >/dev/null 2>&1 || { echo "Not Debian: for PDF and 3-D surfaces install pango, OpenGL (libGL, libEGL) and libusb;${*:+ for browser tests} $*"; exit 0; }
missing=""
for package in $wanted; do
  dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q "install ok installed" || missing="$missing $package"
done
[ -z "$missing" ] && exit 0
if [ "$(id -u)" -ne 0 ]; then
  echo "Not root: for PDF and 3-D surfaces${*:+, and for browser tests,} run once: apt-get install$missing"
  exit 0
fi
export DEBIAN_FRONTEND=noninteractive
apt-get update -qq && apt-get install -y -qq --no-install-recommends $missing >/dev/null || echo "Could not install:$missing; what wants them says so."
exit 0
