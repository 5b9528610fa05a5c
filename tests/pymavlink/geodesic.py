"""Prints the rows of src/pilot/geo_rows.in with GeographicLib (pip install geographiclib==2.1)."""

from geographiclib.geodesic import Geodesic

CASES = [((51.9907, 4.3768), 0.0, 10.0), ((51.9907, 4.3768), 90.0, 10.0),
         ((51.9907, 4.3768), 215.0, 80.0), ((-33.9, 151.2), 300.0, 100.0),
         ((0.0, 0.0), 45.0, 100.0), ((60.0, 179.9999), 90.0, 100.0),
         ((47.397742, 8.545594), 120.0, 500.0), ((37.4, -122.1), 250.0, 1000.0)]

print("[")
for (lat, lon), azimuth, distance in CASES:
    end = Geodesic.WGS84.Direct(lat, lon, azimuth, distance)
    print(f"    ([{lat!r}, {lon!r}], {azimuth!r}, {distance!r}, "
          f"[{end['lat2']:.10f}, {end['lon2']:.10f}]),")
print("]")
