benchtool import $MACHINES/quad_floor/$1.parquet --columns commanded.toml --hover 1.5 --out $1.csv
benchtool fit $1.csv --model step.toml
